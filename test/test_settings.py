# SPDX-License-Identifier: Apache-2.0
from dataclasses import fields, is_dataclass

import pytest

from vega_planner.errors import InvalidInput
from vega_planner.settings import Settings, as_dict, load_settings


def leaves(section, prefix=""):
    for item in fields(section):
        value = getattr(section, item.name)
        if is_dataclass(value):
            yield from leaves(value, f"{prefix}{item.name}.")
        else:
            yield f"{prefix}{item.name}", item, value


def nested(path, value):
    for key in reversed(path.split(".")):
        value = {key: value}
    return value


ALL = list(leaves(Settings()))
BOUNDED = [(p, i, v) for p, i, v in ALL if i.metadata["low"] is not None]
CHOSEN = [(p, i, v) for p, i, v in ALL if i.metadata["choices"]]


@pytest.mark.parametrize("path, item, value", ALL, ids=[p for p, _, _ in ALL])
def test_every_setting_says_what_it_means(path, item, value):
    assert len(item.metadata["doc"]) > 10
    assert item.metadata["doc"].rstrip()[-1] in ".)"


@pytest.mark.parametrize("path, item, value", BOUNDED, ids=[p for p, _, _ in BOUNDED])
def test_a_value_past_either_limit_is_refused_with_name_value_and_limits(path, item, value):
    low, high = item.metadata["low"], item.metadata["high"]
    for bad in (low - 1, high + 1):
        with pytest.raises(InvalidInput) as caught:
            Settings().updated(nested(path, bad))
        assert item.name in str(caught.value) and f"{low:g}" in str(caught.value)
    with pytest.raises(InvalidInput):
        Settings().updated(nested(path, float("nan")))


@pytest.mark.parametrize("path, item, value", CHOSEN, ids=[p for p, _, _ in CHOSEN])
def test_an_unknown_word_is_refused_with_the_choices(path, item, value):
    with pytest.raises(InvalidInput) as caught:
        Settings().updated(nested(path, "sideways"))
    assert all(choice in str(caught.value) for choice in item.metadata["choices"])


def test_settings_survive_the_way_through_yaml(tmp_path):
    import yaml

    wanted = Settings().updated(
        {"layers": {"thickness_mm": 0.5}, "part": {"brr": ["down", "normal:0,0,1"]}, "seed": 3}
    )
    path = tmp_path / "settings.yaml"
    path.write_text(yaml.safe_dump(as_dict(wanted)))
    assert load_settings(path) == wanted


@pytest.mark.parametrize(
    "text, complaint",
    [
        ("layers: {thicknes_mm: 1}", "unknown setting 'layers.thicknes_mm'"),
        ("layers: 3", "settings section 'layers' is 3"),
        ("layers: {thickness_mm: thick}", "expected a number"),
        ("seed: 1.5e", "expected a whole number"),
        ("layers: [", "cannot be read"),
    ],
)
def test_a_bad_settings_file_is_one_clear_line(tmp_path, text, complaint):
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=complaint.replace("[", "\\[")) as caught:
        load_settings(path)
    assert "\n" not in str(caught.value)


def test_a_missing_settings_file_names_itself(tmp_path):
    with pytest.raises(InvalidInput, match=r"none\.yaml"):
        load_settings(tmp_path / "none.yaml")
