"""Fuzzy controllers with a rule base from a file, and the explanations of their answers."""

from dataclasses import replace

import pytest
from pydantic import TypeAdapter

from hil_bridge.control import FuzzyAdaptive, FuzzyPi, Measurement, ResolutionAware, make_controller
from hil_bridge.control.laws.rules import PAPER_RULES, Rule, rules_as_toml
from hil_bridge.errors import ConfigError

KINDS = pytest.mark.parametrize("kind", [FuzzyPi, FuzzyAdaptive, ResolutionAware])


@pytest.fixture
def timid(tmp_path) -> str:
    """A rule base that always answers ZO."""
    rules = tuple(Rule(rule.error, rule.change, "ZO") for rule in PAPER_RULES.rules)
    path = tmp_path / "timid.toml"
    path.write_text(rules_as_toml(replace(PAPER_RULES, rules=rules, printed=None)), encoding="utf-8")
    return str(path)


def answer(controller, force=0.0, reference=50.0):
    return controller.step(controller.initial(), Measurement(0.0, force, 0.0, 0.0), reference)[1]


@KINDS
@pytest.mark.parametrize("surface", ["paper", "rules", "continuous"])
def test_fuzzy_custom_rule_base_replaces_the_papers(kind, surface, timid):
    assert answer(kind(surface=surface)).correction > 0.0
    assert answer(kind(surface=surface, rules_file=timid)).correction == pytest.approx(0.0, abs=1e-12)


@KINDS
def test_fuzzy_answer_names_fired_rules(kind):
    explanation = answer(kind()).explanation
    assert explanation["NB∧ZO→PB"] == 1.0
    assert explanation["NM∧PS→PS"] == 0.3
    assert explanation["level_output"] == 4
    assert answer(kind()).explanation == explanation


@KINDS
def test_fuzzy_rules_file_is_a_parameter(kind, timid, tmp_path):
    assert TypeAdapter(kind).validate_python({"rules_file": timid}) == kind(rules_file=timid)
    assert kind(rules_file=timid) != kind()
    assert hash(kind(rules_file=timid)) == hash(kind(rules_file=timid))
    assert "_system" not in TypeAdapter(kind).json_schema()["properties"]
    with pytest.raises(ConfigError, match=r"cannot read .*none\.toml"):
        make_controller(kind.name, rules_file=str(tmp_path / "none.toml"))
    with pytest.raises(ValueError, match="_system"):
        TypeAdapter(kind).validate_python({"_system": None})
