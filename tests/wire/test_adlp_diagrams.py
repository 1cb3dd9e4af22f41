"""The state diagrams on the reference page are drawn from the link's table."""

import runpy
from pathlib import Path

import pytest

from protocol.devices.s3.adlp import TRANSITIONS, Action, LinkProfile, Role, State

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = (ROOT / "docs" / "reference" / "computer-link.md").read_text(encoding="utf-8")
TOOL = runpy.run_path(str(ROOT / "tools" / "link_diagrams.py"))


def drawn(role):
    """Every (source, target, stimulus) of a role, of both its diagrams."""
    return {
        (source, target, stimulus)
        for sending in (True, False)
        for (source, target), stimuli in TOOL["arrows"](role, sending).items()
        for stimulus in stimuli
    }


def test_the_diagrams_are_those_of_the_table():
    assert TOOL["renewed"](DOCUMENT) == DOCUMENT, "run python -m tools.documents link-diagrams"


@pytest.mark.parametrize("name", ["link-pc-sends.svg", "link-s3-sends.svg", "link-receives.svg"])
def test_each_picture_is_that_of_the_table(name):
    file = ROOT / "docs" / "pictures" / name
    assert TOOL["pictures"]()[name] == file.read_text(encoding="utf-8"), (
        "run python -m tools.documents link-diagrams"
    )
    assert f"(../pictures/{name})" in DOCUMENT


def test_a_document_without_a_place_for_them_is_refused():
    with pytest.raises(ValueError, match="no place for 'state diagrams'"):
        TOOL["renewed"](DOCUMENT.replace("<!-- state diagrams: begin -->", ""))


@pytest.mark.parametrize("role", list(Role))
def test_every_change_of_state_is_an_arrow_once(role):
    wanted = {
        (state, target, stimulus.value)
        for (state, stimulus), transition in TRANSITIONS.items()
        for target in transition.next
        if target is not state and (state is not State.LISTENING or target is State.IDLE)
    }
    if LinkProfile().collision_winner == role:
        wanted.remove((State.BIDDING, State.AWAITING_BLOCK, "ENQ"))
    assert drawn(role) == wanted


def test_only_the_one_who_gives_way_leaves_its_bid_at_a_collision():
    collision = (State.BIDDING, State.AWAITING_BLOCK, "ENQ")
    assert [collision in drawn(role) for role in (Role.HOST, Role.ROBOT)] == [True, False]


def test_where_an_action_has_several_ends_each_has_its_condition():
    forks = {
        (arrow.action, target)
        for arrow in TRANSITIONS.values()
        if len(arrow.next) > 1
        for target in arrow.next
    }
    assert forks == TOOL["CONDITIONS"].keys()


def test_every_pair_of_the_table_has_a_line():
    table = TOOL["table"]()
    assert len(table.splitlines()) == len(TRANSITIONS) + 2
    for action in Action:
        assert f"| {action.value.replace('_', ' ')} |" in table
