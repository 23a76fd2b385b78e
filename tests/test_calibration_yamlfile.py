"""YAML as people write it."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.yamlfile import YamlFileError, dump_yaml, parse_yaml, read_yaml


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("-1E+3", -1000.0),
        (".5", 0.5),
        ("7", 7),
        ("1_000", 1000),
        ("0x1F", 31),
        ("-.inf", -math.inf),
        ("1:30", "1:30"),
        ("'1e-3'", "1e-3"),
        ("._", "._"),
        ("true", True),
        ("~", None),
    ],
)
def test_a_value_is_what_a_person_means(text, value):
    read = parse_yaml(f"a: {text}", "f.yaml")["a"]
    assert read == value
    assert type(read) is type(value)


@given(st.floats(allow_nan=False) | st.integers() | st.booleans() | st.text(max_size=8))
def test_what_is_written_is_read_back(value):
    assert parse_yaml(dump_yaml({"a": [value, {"b": value}]}), "f") == {"a": [value, {"b": value}]}


@pytest.mark.parametrize(
    "text",
    ["a: {b", "a: \t- b", "a: 2001-13-45", "a: !!int x", "a: !!bool x", "? [a]\n: b", "[" * 3000],
)
def test_broken_text_is_one_line_naming_the_file(text):
    with pytest.raises(YamlFileError, match=r"^f\.yaml.*not valid YAML") as caught:
        parse_yaml(text, "f.yaml")
    assert len(str(caught.value).splitlines()) == 1


@given(st.text(alphabet="ab:-[]{}!&*?|>'\"#%0123._ \n", max_size=30))
def test_any_text_is_data_or_a_yaml_error(text):
    with contextlib.suppress(YamlFileError):
        parse_yaml(text, "f.yaml")


def test_files_that_cannot_be_read_say_why(tmp_path):
    (tmp_path / "image.yaml").write_bytes(b"\xff\xd8\xff\xe0")
    for name, why in (("none.yaml", "no such file"), ("image.yaml", "not text"), ("", "directory")):
        with pytest.raises(YamlFileError, match=why):
            read_yaml(tmp_path / name)
