"""The state diagrams on the reference page match the link's table."""

import runpy
from pathlib import Path

import pytest

from protocol.devices.s3.adlp import TRANSITIONS, Action, LinkProfile, Role, State

ROOT = Path(__file__).resolve().parents[2]
TOOL = runpy.run_path(str(ROOT / "tools" / "link_diagrams.py"))


def drawn(role):
    """Every (source, target, stimulus) of a role, from both of its diagrams."""
    return {
        (source, target, stimulus)
        for sending in (True, False)
        for (source, target), stimuli in TOOL["arrows"](role, sending).items()
        for stimulus in stimuli
    }


@pytest.mark.parametrize("role", list(Role))
def test_every_change_of_state_is_an_arrow_once(role):
    expected = {
        (state, target, stimulus.value)
        for (state, stimulus), transition in TRANSITIONS.items()
        for target in transition.next
        if target is not state and (state is not State.LISTENING or target is State.IDLE)
    }
    if LinkProfile().collision_winner == role:
        expected.remove((State.BIDDING, State.AWAITING_BLOCK, "ENQ"))
    assert drawn(role) == expected


def test_only_the_losing_end_abandons_its_bid_at_a_collision():
    collision = (State.BIDDING, State.AWAITING_BLOCK, "ENQ")
    assert [collision in drawn(role) for role in (Role.HOST, Role.ROBOT)] == [True, False]


def test_each_end_of_an_action_has_its_condition():
    forks = {
        (arrow.action, target)
        for arrow in TRANSITIONS.values()
        if len(arrow.next) > 1
        for target in arrow.next
    }
    assert forks == {(action, target) for action, targets in TOOL["CONDITIONS"].items() for target in targets}


def test_every_pair_of_the_table_has_a_place():
    table = TOOL["action_table"]()
    rows = [[cell.strip() for cell in line.strip(" |").split("|")] for line in table.splitlines()[2:]]
    pairs = [(state, stimulus) for state, stimuli, *_ in rows for stimulus in stimuli.split(", ")]
    assert sorted(pairs) == sorted((state.value, stimulus.value) for state, stimulus in TRANSITIONS)
    for action in Action:
        assert f"| {action.value.replace('_', ' ')} |" in table
