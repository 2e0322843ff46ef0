"""A setting is declared once: what follows from the declaration."""

from __future__ import annotations

import dataclasses
import inspect
import pickle
from functools import partial

import pytest

import granphon as gp
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import LENGTH, SINCE
from granphon.base.settings import (
    IN_PYTHON,
    NEEDED,
    Block,
    ValueContext,
    block_kind,
    describe_settings,
    list_settings,
    listed,
    make_rules,
    one_or_more,
    read_block,
    read_counts,
    read_values,
    setting,
    space_evenly,
    whole_from,
    with_unit,
    word_of,
    write_block,
    write_values,
)
from granphon.base.validation import number
from granphon.waves.settings import BLOCKS, DriveSettings, Shaker

WRITTEN = ValueContext()


class Nozzle(Block):
    """Of no use but to be a block."""

    block = "nozzle"

    width: float = setting(with_unit(LENGTH), "between its edges", title="width of the nozzle")
    delay: float | None = setting(with_unit(SINCE), "until it opens", default=None, absent="none")
    balls: int = setting(whole_from(1, 9), "at a time", default=2, title="balls at a time")
    side: str = setting(word_of("left", "right"), "where it is", default="left")


class Funnel(Block, kw_only=True):
    """A block with a block."""

    block = "funnel"

    nozzle: Nozzle = setting(block_kind(Nozzle), "its end")


def test_attributes_follow_from_the_declaration():
    nozzle = Nozzle(0.5, side="right")
    assert (nozzle.width, nozzle.delay, nozzle.balls, nozzle.side) == (0.5, None, 2, "right")
    assert nozzle == Nozzle(width=0.5, side="right")
    assert pickle.loads(pickle.dumps(nozzle)) == nozzle
    assert dataclasses.replace(nozzle, balls=3).balls == 3
    with pytest.raises(dataclasses.FrozenInstanceError):
        nozzle.balls = 3
    with pytest.raises(TypeError, match="width"):
        Nozzle()


def test_a_class_of_a_user_may_have_attributes_and_a_constructor_of_its_own():
    class Wide(Nozzle):
        colour: str = "red"

    class Narrow(Nozzle):
        def __init__(self) -> None:
            super().__init__(width=1e-3)

    assert (Wide(1.0).colour, Wide(1.0, colour="blue").colour) == ("red", "blue")
    assert set(list_settings(Wide)) == set(list_settings(Nozzle))
    assert Narrow().width == 1e-3
    with pytest.raises(InputError, match=r"nozzle\.width"):
        Wide(-1.0)


@pytest.mark.parametrize(
    ("values", "place", "word"),
    [
        ({"width": 0.0}, "nozzle.width", "above zero, m"),
        ({"width": "8 mm"}, "nozzle.width", "'8 mm'"),
        ({"width": None}, "nozzle.width", "nothing"),
        ({"width": 1.0, "balls": None}, "nozzle.balls", "nothing"),
        ({"width": 1.0, "delay": -1.0}, "nozzle.delay", "zero or above, s"),
        ({"width": 1.0, "balls": 10}, "nozzle.balls", "from 1 to 9"),
        ({"width": 1.0, "side": "rigth"}, "nozzle.side", "'right'"),
    ],
)
def test_values_of_python_are_checked(values, place, word):
    with pytest.raises(InputError) as refused:
        Nozzle(**values)
    assert str(refused.value).startswith(f"{place}: ")
    assert word in str(refused.value)


def test_a_block_of_a_file_has_units_and_is_written_as_it_is_read():
    nozzle = read_block(Nozzle, {"width": "8 mm", "delay": "2 ms"}, WRITTEN)
    assert nozzle == Nozzle(0.008, 0.002)
    written = write_block(nozzle, WRITTEN)
    assert written == {"width": "0.008 m", "delay": "0.002 s", "balls": 2, "side": "left"}
    assert read_block(Nozzle, written, WRITTEN) == nozzle
    assert "delay" not in write_block(Nozzle(1.0), WRITTEN)
    assert read_block(Nozzle, nozzle, WRITTEN) is nozzle
    assert read_block(Nozzle, {"width": 0.008, "delay": 2e-3}, IN_PYTHON) == nozzle


@pytest.mark.parametrize(
    ("value", "path", "word"),
    [
        ({"balls": 2}, ("width",), "such as '8 mm'"),
        ({"width": 8.0}, ("width",), "without a unit"),
        ({"width": "8 mm", "widht": 1}, ("widht",), "unknown key"),
        ({"width": "8 mm", "side": 3}, ("side",), "left, right"),
        ("8 mm", (), "width, delay, balls, side"),
    ],
)
def test_a_refusal_names_the_key(value, path, word):
    with pytest.raises(Refused) as refused:
        read_block(Nozzle, value, WRITTEN)
    assert refused.value.path == path
    assert word in str(refused.value)


def test_blocks_inside_blocks_and_lists():
    funnel = read_block(Funnel, {"nozzle": {"width": "1 m"}}, WRITTEN)
    assert funnel == Funnel(nozzle=Nozzle(1.0))
    assert write_block(funnel, WRITTEN)["nozzle"]["width"] == "1.0 m"
    with pytest.raises(Refused) as refused:
        read_block(Funnel, {"nozzle": {"width": "1 m", "balls": 0}}, WRITTEN)
    assert refused.value.path == ("nozzle", "balls")
    lengths = one_or_more(with_unit(LENGTH), "lengths")
    assert lengths.read("1 m", WRITTEN) == (1.0,)
    assert lengths.read(["1 m", "2 m"], WRITTEN) == (1.0, 2.0)
    assert lengths.write((1.0,), WRITTEN) == "1.0 m"
    assert lengths.write((1.0, 2.0), WRITTEN) == ["1.0 m", "2.0 m"]
    with pytest.raises(Refused) as refused:
        listed(with_unit(LENGTH)).read(["1 m", "1 s"], WRITTEN)
    assert refused.value.path == (1,)


def test_the_docstring_lists_what_is_declared():
    told = inspect.cleandoc(Nozzle.__doc__)
    for name, declared in list_settings(Nozzle).items():
        assert f"\n{name} : {declared.meaning}" in told
    # what a docstring tells itself stays as it is
    assert inspect.cleandoc(gp.Material.__doc__).count("\ndensity : ") == 1
    assert "Attributes" not in gp.Material.__doc__


def test_words_follow_from_the_declaration():
    settings = list_settings(Nozzle)
    assert [declared.default for declared in settings.values()] == [NEEDED, "none", "`2`", "`left`"]
    assert settings["width"].kind.unit == "m"
    assert describe_settings(Nozzle(0.5)) == [
        ("width of the nozzle", 0.5, "m"),
        ("balls at a time", 2, ""),
    ]


@pytest.mark.parametrize("block_class", [*BLOCKS.values(), DriveSettings, Shaker])
def test_every_block_of_waves_is_declared_whole(block_class):
    settings = list_settings(block_class)
    assert set(settings) == {field.name for field in dataclasses.fields(block_class)}
    assert set(make_rules(block_class, WRITTEN)) == set(settings)
    assert all(declared.meaning and declared.default for declared in settings.values())
    # losses are told by the class that all blocks with losses have in common
    told = "\n".join(owner.__doc__ or "" for owner in block_class.__mro__)
    assert all(
        f"{name} : " in told or f"{name}, " in told or f", {name}" in told
        for name in settings
        if name not in ("repeat", "cut")
    )
    for name, declared in settings.items():
        default = {field.name: field for field in dataclasses.fields(block_class)}[name].default
        # a default is what a file may say
        if default not in (None, (), dataclasses.MISSING):
            written = declared.kind.write(default, WRITTEN)
            assert declared.kind.read(written, WRITTEN) == default


def test_counts_of_very_many_digits_are_refused():
    assert read_counts("3 5", "numbers", 1, 10) == (3, 5)
    for text in ("1" * 5000, "3 x", "\u0663"):
        with pytest.raises(Refused):
            read_counts(text, "numbers", 1, 10)


def test_a_range_too_wide_for_a_float_is_refused():
    rule = partial(number, low=-1.7e308, high=1.7e308)
    wide = {"from": -1.7e308, "to": 1.7e308, "points": 3, "scale": "linear"}
    with pytest.raises(Refused, match="range from"):
        read_values(wide, rule)
    assert read_values(wide | {"from": 0.0}, rule) == (0.0, 0.85e308, 1.7e308)


def test_values_that_are_written_are_read_up_to_the_most_points_of_a_range_and_beyond():
    for count, kind in ((200_000, dict), (200_001, list)):
        values = space_evenly(1.0, 20.0, count, "linear")
        plain_values = write_values(values, float)
        assert isinstance(plain_values, kind)
        assert read_values(plain_values, float) == values
