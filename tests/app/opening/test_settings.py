"""Settings are read from text as their fields describe them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.opening.settings import apply_settings, expectation, read_value, settings_table
from terrain.errors import InputError
from terrain.renderers import RENDERERS
from terrain.settings import setting
from terrain.textures.look import LookSettings


@dataclass(frozen=True)
class Example:
    share: float = setting(0.5, "Share", "A share.", unit="%", range=(0.0, 1.0))
    cells: int = setting(16, "Cells", "Cells.", choices=(8, 16), rebuild=True)
    count: int = setting(3, "Count", "A count.", range=(1, 9))
    on: bool = setting(True, "On", "A switch.")


FIELDS = {field.name: field for field in dataclasses.fields(Example)}


def test_values_take_the_type_of_their_field():
    (changed,) = apply_settings(["share=0.25", "cells=8", "count=4", "on=off"], Example())
    assert changed == Example(0.25, 8, 4, False)
    assert isinstance(changed.cells, int)


@pytest.mark.parametrize(
    "pair", ["share=2", "share=nan", "share=x", "cells=9", "count=0", "count=2.5", "on=maybe", "other=1", "share"]
)
def test_bad_values_are_refused_in_one_line(pair):
    with pytest.raises(InputError) as refused:
        apply_settings([pair], Example())
    assert "\n" not in str(refused.value)
    assert pair.partition("=")[0] in str(refused.value)


@given(st.floats(allow_nan=True) | st.text(max_size=8))
def test_a_number_out_of_range_is_never_taken(value):
    try:
        taken = read_value(FIELDS["share"], str(value))
    except InputError:
        return
    assert 0.0 <= taken <= 1.0


def test_a_misspelt_name_is_answered_with_the_nearest():
    with pytest.raises(InputError, match="did you mean count"):
        apply_settings(["cuont=3"], Example())


def test_one_name_reaches_every_settings_that_has_it():
    look, example = apply_settings(["fog=off", "count=5"], LookSettings(), Example())
    assert (look.fog, example.count) == (False, 5)


def test_expectations_are_words():
    assert expectation(FIELDS["share"]) == "0 to 1 %"
    assert expectation(FIELDS["cells"]) == "8 or 16"
    assert expectation(FIELDS["on"]) == "on or off"


@pytest.mark.parametrize("settings", [*(kind.Settings() for kind in RENDERERS.values()), LookSettings()], ids=repr)
def test_defaults_of_all_settings_lie_within_what_they_accept(settings):
    for field in dataclasses.fields(settings):
        assert read_value(field, str(field.default)) == field.default
        assert field.name in settings_table(settings, "title")
        assert field.metadata["help"].endswith(".")
