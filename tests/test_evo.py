"""evo, another's tool for paths, reads our TUM files and finds the same errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

evo = pytest.importorskip("evo", reason="evo is in the development extra only")


def rmse(estimate: Path, reference: Path) -> float:
    """evo_ape tum --align: SE(3), positions."""
    from evo.core import metrics, sync
    from evo.tools import file_interface

    paths = [file_interface.read_tum_trajectory_file(str(f)) for f in (reference, estimate)]
    true, found = sync.associate_trajectories(*paths, max_diff=0.01)
    found.align(true)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((true, found))
    return float(ape.get_statistic(metrics.StatisticsType.rmse))


@pytest.mark.parametrize("name", ["trajectory", "online", "odometry"])
def test_the_same_error_as_ours(office_run, beemap, name):
    files = office_run / f"{name}.tum", office_run / "truth.tum"
    ours = json.loads(beemap("evaluate", "path", *files, "--json").out)["ate_rmse_m"]
    assert ours > 1e-3  # there is something to measure
    assert rmse(*files) == pytest.approx(ours, abs=2e-6)  # TUM files keep micrometres
