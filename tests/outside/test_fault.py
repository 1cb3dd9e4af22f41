"""Test as a user writes it: the emergency stop is pressed while the tool presses."""

import time

import hil_bridge

STOP = {"on": "robot", "fault": "emergency-stop", "phase": "track", "after_s": 0.5}
hil_bridge.load()  # the first import takes its time here


def test_emergency_stop_ends_run_with_report():
    began = time.process_time()
    result = hil_bridge.simulate({"run": {"duration_s": 3.0}}, faults=[STOP], seed=7)
    assert result.outcome == "stopped"
    assert "emergency stop" in result.text
    assert max(result.arrays.force) < 15.0
    assert result.arrays.truths.force[:, 2].max() < 15.0
    assert time.process_time() - began < 1.0
