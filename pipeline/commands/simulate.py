"""`beemap simulate`: recordings and scan logs out of nothing, with the truth beside them."""

from __future__ import annotations

import click

from pipeline.commands.simulate_degrade import degrade
from pipeline.commands.simulate_paper import paper
from pipeline.commands.simulate_rendered import PRESETS, rendered
from pipeline.commands.simulate_rig import rig


@click.group()
def simulate() -> None:
    """Make recordings and runs out of nothing, with the truth beside them."""


for preset in PRESETS:
    simulate.add_command(rendered(preset))
simulate.add_command(paper)
simulate.add_command(degrade)
simulate.add_command(rig)
