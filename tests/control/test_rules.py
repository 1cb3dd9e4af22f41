"""Custom rule bases: read, checked, and inferred like the paper's."""

import math
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control.laws.fuzzy import Inference, InferenceSystem, Surface
from hil_bridge.control.laws.rules import PAPER_RULES, parse_rules, read_rules, rules_as_toml
from hil_bridge.control.laws.tables import GAIN_MATRIX
from hil_bridge.errors import ConfigError

SMALL = """
levels = [-1, 0, 1]

[terms]
N = [1.0, 0.5, 0.0]
P = [0.0, 0.5, 1.0]

[error]
edges_percent = [-10.0, 10.0]

[change]
levels = [-2, -1, 1, 2]
edges_percent = [-20.0, 0.0, 20.0]
terms.down = [1.0, 0.6, 0.0, 0.0]
terms.up = [0.0, 0.0, 0.6, 1.0]

[output]
levels = [-3.0, -1.5, 0.0, 1.5, 3.0]
terms.out = [1.0, 0.5, 0.0, 0.0, 0.0]
terms.stay = [0.0, 0.5, 1.0, 0.5, 0.0]
terms.in = [0.0, 0.0, 0.0, 0.5, 1.0]

[inference]
rules = [
  ["N", "down", "in"], ["N", "up", "stay"],
  ["P", "down", "stay"], ["P", "up", "out"],
]
"""


def test_paper_rule_base_round_trips():
    assert parse_rules(rules_as_toml(PAPER_RULES)) == PAPER_RULES


def test_custom_rule_base_round_trips_as_plain_toml():
    base = parse_rules(SMALL)
    assert parse_rules(rules_as_toml(base)) == base
    assert tomllib.loads(rules_as_toml(base))["inference"]["rules"][0] == ["N", "down", "in"]
    assert base.error.levels == (-1, 0, 1)
    assert base.change.levels == (-2, -1, 1, 2)
    assert base.printed is None


def test_term_names_may_contain_any_text():
    base = parse_rules(
        SMALL.replace('"down"', '"langsam, \\"fallend\\" ∧"').replace(".down", '."langsam, \\"fallend\\" ∧"')
    )
    assert base.change.terms[0].name == 'langsam, "fallend" ∧'
    assert parse_rules(rules_as_toml(base)) == base


def test_paper_rule_base_supports_both_tables():
    printed, computed = (
        [
            [int(system.evaluate(error, change).level_output) for change in (-30.0, -0.1, 30.0)]
            for error in (-60.0, 0.0, 60.0)
        ]
        for system in (InferenceSystem(PAPER_RULES, s) for s in (Surface.PAPER, Surface.RULES))
    )
    assert printed == [[GAIN_MATRIX[i][j] for j in (0, 6, 12)] for i in (0, 6, 12)]
    assert (printed[2][1], computed[2][1]) == (-5, -4)


@pytest.mark.parametrize("surface", [Surface.PAPER, Surface.RULES])
def test_small_rule_base_matches_hand_calculation(surface):
    system = InferenceSystem(parse_rules(SMALL), surface)
    # One rule fully: `in` is 0.5 at 1.5 and 1 at 3, its centre of gravity 2.5, the nearest level 3.
    result = system.evaluate(-50.0, -50.0)
    assert (result.level_error, result.level_change, result.level_output) == (-1, -2, 3.0)
    # N and P to 0.5 each, `down` to 0.6: in and stay cut at 0.5, (−1.5+1.5+3)·0.5 over 4·0.5 is 0.75, equally
    # near to 0 and to 1.5.
    result = system.evaluate(0.0, -10.0)
    assert (result.level_error, result.level_change, result.level_output) == (0, -1, 0.0)


def test_continuous_surface_is_not_rounded():
    system = InferenceSystem(parse_rules(SMALL), Surface.CONTINUOUS)
    # A change of −10 % lies in the middle of level −1; error 0 in the middle of level 0.
    result = system.evaluate(0.0, -10.0)
    assert (result.level_error, result.level_change) == (0.0, pytest.approx(-1.0))
    assert result.level_output == pytest.approx(0.75)
    assert system.evaluate(-50.0, -50.0).level_output == pytest.approx(2.5)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.sampled_from(Surface))
def test_fired_rules_explain_output(error, change, surface):
    system = InferenceSystem(PAPER_RULES, surface)
    fired = system.explain(error, change)
    levels = fired.pop("level_error"), fired.pop("level_change"), fired.pop("level_output")
    assert Inference(*levels) == system.evaluate(error, change)
    assert fired
    assert all(0.0 < weight <= 1.0 for weight in fired.values())
    shapes = {term.name: term.degrees for term in PAPER_RULES.output.terms}
    heights = [
        max(min(weight, shapes[name.split("→")[1]][i]) for name, weight in fired.items()) for i in range(13)
    ]
    centre = sum(h * level for h, level in zip(heights, PAPER_RULES.output.levels, strict=True)) / sum(
        heights
    )
    slack = {Surface.CONTINUOUS: 1e-9, Surface.RULES: 0.5 + 1e-9, Surface.PAPER: 1.1}[surface]
    assert system.evaluate(error, change).level_output == pytest.approx(centre, abs=slack)


def test_fired_rules_are_named_with_weights():
    system = InferenceSystem(PAPER_RULES, Surface.PAPER)
    # Error level −6: NB 1, NM 0.3. Change level 0: ZO 1, NS and PS 0.3.
    fired = {
        "NB∧NS→PB": 0.3,
        "NB∧ZO→PB": 1.0,
        "NB∧PS→PM": 0.3,
        "NM∧NS→PM": 0.3,
        "NM∧ZO→PM": 0.3,
        "NM∧PS→PS": 0.3,
    }
    levels = {"level_error": -6.0, "level_change": 0.0, "level_output": 4.0}
    assert system.explain(-100.0, 0.0) == {**fired, **levels}
    system.explain(-100.0, 0.0).clear()
    assert system.explain(-100.0, 0.0) == {**fired, **levels}


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('["N", "up", "stay"],', "", "rules: no rule for error N with change up"),
        (
            '["N", "up", "stay"],',
            '["N", "up", "stay"], ["N", "up", "in"],',
            "rules, number 3: error N with change up gives in, but stay in an earlier rule",
        ),
        ('["N", "up", "stay"]', '["N", "up", "away"]', "number 2: output has no term 'away'"),
        ('["N", "up", "stay"]', '["N", "sideways", "stay"]', "number 2: change has no term 'sideways'"),
        ('["N", "up", "stay"]', '["N", "up"]', "number 2 must be three names of terms"),
        (
            "N = [1.0, 0.5, 0.0]",
            "N = [1.0, 0.5]",
            "error.terms.N must have 3 degrees, one for each level, got 2",
        ),
        (
            "N = [1.0, 0.5, 0.0]",
            "N = [1.0, nan, 0.0]",
            "error.terms.N must be within 0 and 1, got nan at level 0",
        ),
        ("N = [1.0, 0.5, 0.0]", "N = [1.5, 0.5, 0.0]", "error.terms.N must be within 0 and 1, got 1.5"),
        ("N = [1.0, 0.5, 0.0]", "N = [0, 0, 0]", "error.terms.N is 0 at every level"),
        ("N = [1.0, 0.5, 0.0]", 'N = ["all", 0, 0]', "error.terms.N must be numbers, got 'all'"),
        ("0.6, 0.0, 0.0]", "0.0, 0.0, 0.0]", "change.terms leave a gap: no term is above 0 at level -1"),
        ("[-20.0, 0.0, 20.0]", "[-20.0, 20.0, 0.0]", "change.edges_percent must ascend, but 0 follows 20"),
        ("[-20.0, 0.0, 20.0]", "[-20.0, nan, 20.0]", "change.edges_percent must be finite"),
        (
            "[-20.0, 0.0, 20.0]",
            "[-20.0, 20.0]",
            "change.edges_percent must be 3 numbers, one fewer than levels",
        ),
        ("edges_percent = [-20.0, 0.0, 20.0]", "", "change.edges_percent is missing"),
        ("levels = [-1, 0, 1]", "levels = [-1, 0, 0]", "error.levels must ascend, but 0 follows 0"),
        ("levels = [-1, 0, 1]", "", "error.levels is missing"),
        ("levels = [-1, 0, 1]", "level = [-1, 0, 1]", "level is not an entry of a rule base; known: change"),
        ("levels = [-3.0", "edges_percent = []\nlevels = [-3.0", "output.edges_percent is not an entry"),
        ("[inference]", "[inference]\nprinted = [[0, 0], [0, 0]]", "printed must have 3 rows of 4 numbers"),
        (
            "[inference]",
            f"[inference]\nprinted = {[[9.0] * 4] * 3}",
            "printed must stay within the output's levels",
        ),
        ("[inference]", "[inference", "is not valid TOML"),
    ],
)
def test_rule_error_names_file_and_entry_in_one_line(tmp_path, before, after, message):
    assert before in SMALL
    path = tmp_path / "mine.toml"
    path.write_text(SMALL.replace(before, after, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as raised:
        read_rules(path)
    text = str(raised.value)
    assert message in text
    assert text.startswith(str(path))
    assert "\n" not in text


def test_several_missing_rules_are_counted():
    with pytest.raises(ConfigError, match=r"error N with change down \(and 3 more\)"):
        parse_rules(SMALL[: SMALL.index("[inference]")] + "[inference]\nrules = []\n")


def test_unreadable_rules_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot read .*none\.toml: No such file"):
        read_rules(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match=r"bytes\.toml is not valid utf-8"):
        read_rules(tmp_path / "bytes.toml")


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-3, 3) | st.floats() | st.sampled_from(["N", "P", "ZO"]),
        lambda inner: (
            st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from("NPZ"), inner, max_size=3)
        ),
        max_leaves=12,
    ),
    st.sampled_from(["levels", "terms", "error", "change", "output", "inference"]),
)
def test_invalid_rules_raise_only_config_error(value, entry):
    from hil_bridge.control.laws import rules

    values = tomllib.loads(SMALL) | {entry: value}
    try:
        base = rules._base(values)
    except ValueError:
        return
    assert math.isfinite(InferenceSystem(base, Surface.RULES).evaluate(1.0, 1.0).level_output)
