"""The table of variables: names, units and signs, and that the model has what it says."""

import re
from operator import attrgetter

import pytest
from small_run import small_model

from floebmi import AirDrag, CoriolisField, InputError, Model, OceanDrag, Tilt
from floebmi.variables import FLOE_VARIABLES, VARIABLES, find, inputs, outputs, table

ALL = (*VARIABLES, *FLOE_VARIABLES)

# Canonical units of the CF standard name table, version 93
CF_UNITS = {
    "coriolis_parameter": "s-1",
    "downward_{a}_stress_at_sea_ice_base": "Pa",
    "maximum_over_coordinate_rotation_of_sea_ice_horizontal_shear_stress": "N m-1",
    "projection_{a}_coordinate": "m",
    "sea_ice_amount": "kg m-2",
    "sea_ice_area_fraction": "1",
    "sea_ice_thickness": "m",
    "sea_ice_{a}_internal_stress": "N m-2",
    "sea_ice_{a}_velocity": "m s-1",
    "surface_downward_{a}_stress": "Pa",
    "surface_sea_water_{a}_velocity": "m s-1",
    "{a}_wind": "m s-1",
}
SYMBOLS = {  # powers of kg, m, s
    "1": (0, 0, 0),
    "kg": (1, 0, 0),
    "m": (0, 1, 0),
    "s": (0, 0, 1),
    "rad": (0, 0, 0),
    "N": (1, 1, -2),
    "Pa": (1, -1, -2),
    "J": (1, 2, -2),
}


def dimension(units):
    total = [0, 0, 0]
    for word in units.split():
        symbol, power = re.fullmatch(r"([A-Za-z]+|1)(-?\d+)?", word).groups()
        for k, one in enumerate(SYMBOLS[symbol]):
            total[k] += one * int(power or 1)
    return tuple(total)


@pytest.mark.parametrize("column", ["name", "csdms", "cf", "file_name"])
def test_names_are_unique(column):
    for rows in (VARIABLES, FLOE_VARIABLES):
        names = [getattr(row, column) for row in rows if getattr(row, column) is not None]
        assert len(set(names)) == len(names)


def test_csdms_names_are_unique_over_both_tables_and_follow_the_grammar():
    names = [row.csdms for row in ALL]
    assert len(set(names)) == len(names)
    word = r"[a-z]+(?:[-~_]?[a-zA-Z0-9]+)*"
    for name in names:
        assert re.fullmatch(f"{word}__{word}", name), name


def test_cf_names_are_in_the_standard_name_table_and_have_its_dimensions():
    known = {name.format(a=a): units for name, units in CF_UNITS.items() for a in "xy"}
    for row in ALL:
        if row.cf is not None:
            assert dimension(row.units) == dimension(known[row.cf]), row.name


def test_units_are_made_of_symbols_that_udunits_knows():
    for row in ALL:
        dimension(row.units)


def test_vectors_come_in_pairs_whose_texts_name_their_own_axis():
    names = {row.name: row for row in VARIABLES}
    pairs = [name[:-2] for name in names if re.search("[^x]_x$", name)]
    assert {"ocean_velocity", "wind", "ocean_stress", "air_impulse"} <= set(pairs)
    for pair in pairs:
        one, other = names[f"{pair}_x"], names[f"{pair}_y"]
        assert re.sub(r"\bx\b", "y", one.text) == other.text
        assert one.positive.replace("+x", "+y") == other.positive


def test_everything_with_a_sign_says_it():
    for row in ALL:
        if re.search("_[xy]$|stress_(xx|yy)|pressure|angle|angular", row.name):
            if row.name != "ocean_stress_magnitude":
                assert row.positive, row.name


def test_stress_is_by_ice_on_ocean_and_by_air_on_ice():
    assert find("ocean_stress_x").positive.startswith("by ice on ocean")
    assert find("ocean_impulse_y").positive.startswith("by ice on ocean")
    assert find("air_stress_x").positive.startswith("by air on ice")


def test_the_model_gives_each_gridded_output_and_no_other():
    fields = small_model().fields()
    assert set(fields) == {row.name for row in outputs()}
    assert all(fields[row.name].dtype == row.dtype for row in outputs())


def test_each_input_has_its_array_in_the_model():
    like = small_model()
    forces = [OceanDrag(), AirDrag(), Tilt(), CoriolisField()]
    model = Model(like.domain, like.floes, like.contact, forces, like.grid)
    homes = {row.home for row in inputs()}
    assert len(homes) == len(inputs())
    for row in inputs():
        assert attrgetter(row.home)(model).shape == (model.grid.size,)


def test_floe_variables_are_properties_of_floes_with_their_types():
    floes = small_model().floes
    for row in FLOE_VARIABLES:
        if row.intent == "restart":
            assert getattr(floes, row.name).dtype == row.dtype, row.name


def test_a_variable_is_found_by_each_of_its_names():
    row = find("area_fraction")
    assert find("sea_ice__area_fraction") is row
    assert find("sea_ice_area_fraction") is row


def test_an_unknown_name_is_answered_with_a_near_one():
    with pytest.raises(InputError, match="did you mean 'area_fraction'"):
        find("area_fractoin")


def test_the_printed_table_has_a_line_for_each_variable():
    lines = table().splitlines()
    assert len(lines) == 2 + len(ALL)
    assert all(line.count("|") == lines[0].count("|") for line in lines)
