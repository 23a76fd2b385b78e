"""YAML as people write it: `1e-3` is a number, and a broken file is one clear line.

PyYAML follows YAML 1.1, where `1e-3` is a string because it has no dot; every file a user
edits goes through `read_yaml` instead, which follows YAML 1.2 for floats.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml


class YamlFileError(ValueError):
    """A YAML file that cannot be read; the message names the file and the line."""


class _Loader(yaml.SafeLoader):
    pass


_FLOAT = re.compile(
    r"""^[-+]?(?:[0-9][0-9_]*\.?[0-9_]*(?:[eE][-+]?[0-9]+)?
    |\.[0-9][0-9_]*(?:[eE][-+]?[0-9]+)?
    |\.(?:inf|Inf|INF))$|^\.(?:nan|NaN|NAN)$""",
    re.X,
)
_INT = re.compile(r"^[-+]?(?:0|[1-9][0-9_]*|0x[0-9a-fA-F][0-9a-fA-F_]*)$")
_Loader.yaml_implicit_resolvers = {
    first: [(tag, rx) for tag, rx in rules if not tag.endswith((":float", ":int"))]
    for first, rules in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
# The int rule stands before the float rule: the first that matches names the tag.
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", _INT, list("-+0123456789"))
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))


class _Dumper(yaml.SafeDumper):
    """Quotes what YAML 1.1 or `_Loader` would take for a number."""


_Dumper.add_implicit_resolver("tag:yaml.org,2002:int", _INT, list("-+0123456789"))
_Dumper.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))


def parse_yaml(text: str, source: str) -> Any:
    """Parse YAML text; `source` names it in the message of a `YamlFileError`."""
    try:
        return yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or "not YAML"
        raise YamlFileError(f"{source}{where}: not valid YAML ({problem})") from None
    except (ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        # What PyYAML stumbles over: no such date, a tag that does not fit, nesting without end.
        raise YamlFileError(f"{source}: not valid YAML ({error})") from None


def read_yaml(path: Path) -> Any:
    """Read a YAML file.

    Raises:
        YamlFileError: the file is missing, unreadable, not text or not YAML.
    """
    return parse_yaml(read_text(path), str(path))


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        YamlFileError: the file is missing, unreadable or not text.
    """
    try:
        return Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise YamlFileError(f"{path}: no such file") from None
    except OSError as error:
        raise YamlFileError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise YamlFileError(f"{path}: cannot be read (not text in UTF-8)") from None


def dump_yaml(data: Any) -> str:
    """YAML text with keys in the order given and short lists on one line."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100)
