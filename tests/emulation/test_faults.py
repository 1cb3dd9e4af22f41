"""Tests of the emulated devices' faults at their exact samples, even if samples were computed ahead."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.arm.waypoints import Waypoint
from emulators.devices.jr3 import BoardProfile, SensorProfile
from emulators.devices.jr3.sensor import SENSOR_RATE_HZ
from emulators.faults import Ledger
from emulators.faults.ledger import INJECTION_LIMIT
from emulators.faults.packets import BYTES, DATAGRAMS, FRAMES, WIRE
from emulators.sensing.faults import SIGNAL_FAULTS
from emulators.sensing.signal import Signal
from emulators.surface.contact import SurfaceProfile
from emulators.surface.faults import ObstacleProfile
from emulators.surface.materials import MaterialKind, MaterialProfile
from protocol.can.frame import CanFrame
from tests.emulation.bad_wire import BadWire
from tests.paper_cell import BOARD, GATEWAY, UART, PaperCell, PaperCellProfile, Receiver, s3_jr3_cell

T0 = 4000.375
RATE = SENSOR_RATE_HZ
DOWN = (0.0, 1.0, 0.0, 0.0)
LINEAR = SurfaceProfile()
SOLID = SurfaceProfile(material=MaterialProfile(MaterialKind.STANDARD_LINEAR_SOLID))
SURFACES = pytest.mark.parametrize("surface", [LINEAR, SOLID], ids=["linear", "remembers"])
Inject = Callable[[PaperCell, float], object]


def moving_cell(surface: SurfaceProfile = LINEAR) -> PaperCell:
    """Return a cell whose tool presses into the surface from 1 s on, 4 mm deep, and moves up again slowly."""
    cell = s3_jr3_cell(PaperCellProfile(surface=surface), T0, seed=3)
    for depth, speed in ((-0.012, 0.01), (-0.014, 0.01), (-0.011, 0.001)):
        cell.robot.motion.enqueue(Waypoint((0.9, -0.1, 0.6 + depth), DOWN, speed), T0)
    return cell


def counts(
    cell: PaperCell, inject: Inject | None = None, at: float = 2.0, begin: float = 0.0
) -> NDArray[Any]:
    """Return counts of all samples of four seconds, read in blocks of 10 ms; `at` gives the time of the injection."""
    blocks, step, injected = [], RATE // 100, inject is None
    first = round((T0 + begin) * RATE)
    last = round((T0 + 4.0) * RATE)
    while first < last:
        if not injected and first / RATE >= T0 + at:
            assert inject is not None
            inject(cell, first / RATE)
            injected = True
        # Like a gateway: it reads everything available, and uses the part that is due.
        blocks.append(cell.sensor.jr3.counts_from(first, first + step - 1)[:step].copy())
        first += step
    return np.concatenate(blocks)


def scaled(**parameters: object) -> Inject:
    return lambda cell, now: cell.inject("signal", "scale", now, **parameters)


@SURFACES
def test_signal_fault_affects_exact_sample_range(surface: SurfaceProfile) -> None:
    clean = counts(moving_cell(surface))
    broken = counts(moving_cell(surface), scaled(axis="fz", factor=-3.0, for_s=0.5))
    begin, end = 2 * RATE, 2 * RATE + RATE // 2
    other = [0, 1, 3, 4, 5]
    assert np.array_equal(clean[:, other], broken[:, other])
    assert np.array_equal(clean[:begin, 2], broken[:begin, 2])
    assert np.array_equal(clean[end:, 2], broken[end:, 2])
    # N, without the noise of some counts: the wrench before the converter is scaled
    assert np.allclose(broken[begin:end, 2], -3.0 * clean[begin:end, 2], atol=40.0)
    assert (np.abs(broken[begin:end, 2] - clean[begin:end, 2]) > 100).all()


@pytest.mark.sweep
@SURFACES
@pytest.mark.parametrize(
    ("target", "fault", "parameters"),
    [
        ("signal", "offset", {"amount": 7.0}),
        ("surface", "step", {"mm": 2.0}),
        ("surface", "swings", {"mm": 0.5}),
        ("surface", "hard", {"factor": 3.0}),
        ("obstacle", "above", {"height_mm": 0.0}),
    ],
)
def test_fault_invalidates_samples_computed_ahead(
    surface: SurfaceProfile, target: str, fault: str, parameters: dict[str, object]
) -> None:
    def inject(cell: PaperCell, now: float) -> None:
        cell.inject(target, fault, now, **parameters)

    # One reader continues across the fault, the other starts when the fault begins.
    surprised = counts(moving_cell(surface), inject)
    cell = moving_cell(surface)
    inject(cell, T0 + 2.0)
    knowing = counts(cell)
    assert np.array_equal(surprised, knowing)
    assert not np.array_equal(surprised, counts(moving_cell(surface)))


@SURFACES
def test_fault_ended_early_leaves_no_trace(surface: SurfaceProfile) -> None:
    cell = moving_cell(surface)

    def inject(cell: PaperCell, now: float) -> None:
        cell.inject("signal", "offset", now, amount=7.0)
        cell.ledger.mend(now)

    assert np.array_equal(counts(cell, inject), counts(moving_cell(surface)))


def signal(fault: str, **parameters: object) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return counts of the last two seconds, without a fault and with a fault for all of them."""
    clean = counts(moving_cell())[2 * RATE :]
    broken = counts(moving_cell(), lambda cell, now: cell.inject("signal", fault, now, **parameters))
    return clean, broken[2 * RATE :]


def test_stuck_signal_repeats_first_sample() -> None:
    clean, broken = signal("stuck")
    assert np.array_equal(broken, np.broadcast_to(clean[0], clean.shape))


def test_dead_axis_reports_noise_only() -> None:
    clean, broken = signal("dead", axis="all")
    assert np.abs(clean[:, 2]).max() > 500
    assert np.abs(broken).max() < 8
    assert broken.std() == pytest.approx(1.0, abs=0.1)


def test_axes_can_be_swapped_turned_and_negated() -> None:
    clean, broken = signal("swapped", axis="fx", other="mz")
    assert np.abs(broken[:, 2] - clean[:, 2]).max() == 0
    clean, broken = signal("turned", degrees=180.0)
    assert np.allclose(broken[:, [0, 1, 3, 4]], -clean[:, [0, 1, 3, 4]], atol=12)
    clean, broken = signal("sign", axis="fz")
    assert np.allclose(broken[:, 2], -clean[:, 2], atol=12)


def test_intermittent_axis_alternates() -> None:
    clean, broken = signal("intermittent", axis="fz", period_s=0.2, duty=0.25)
    lost = np.arange(len(clean)) % (RATE // 5) < 0.75 * RATE / 5
    assert np.array_equal(broken[~lost], clean[~lost])
    assert np.abs(broken[lost, 2]).max() < 8


def test_spike_lasts_configured_duration() -> None:
    clean, broken = signal("spike", amount=60.0)
    differs = np.flatnonzero(broken[:, 2] != clean[:, 2])
    assert (differs[0], differs[-1], len(differs)) == (0, 39, 40), "5 ms at 8 kHz"


def test_noise_fault_scales_noise_only() -> None:
    clean, broken = signal("noise", factor=30.0)
    assert (broken[:, 0] - clean[:, 0]).std() == pytest.approx(29.0, rel=0.05)
    quiet = s3_jr3_cell(PaperCellProfile(sensor=replace(PaperCellProfile().sensor, noise_counts=0.0)), T0, 1)
    with pytest.raises(ValueError, match="this sensor has no noise"):
        quiet.inject("signal", "noise", T0)


def test_receiver_board_has_same_faults_at_same_samples() -> None:
    def raw(begin: float | None) -> NDArray[Any]:
        cell, first = moving_cell(), round(T0 * RATE)
        if begin is not None:
            cell.inject("signal", "sign", T0 + begin, axis="fz", for_s=1.0)
        return cell.sensor.jr3.raw(first, first + 4 * RATE)

    clean, broken = raw(None), raw(2.0)
    differs = np.flatnonzero((clean != broken).any(axis=1))
    assert (differs[0], differs[-1]) == (2 * RATE, 3 * RATE - 1)


# --- what is touched


def force(cell: PaperCell, at: float) -> float:
    return cell.true_state(T0 + at).contact_force[2]


def test_surface_step_ramps_up_and_back() -> None:
    cell = moving_cell()
    cell.robot.motion.halt(T0 + 1.3)  # 3 mm deep: 15 N
    before = force(cell, 2.0)
    cell.inject("surface", "step", T0 + 2.0, mm=1.0, ramp_ms=200.0, for_s=1.0)
    assert [force(cell, at) - before for at in (2.0, 2.1, 2.25, 2.9, 3.1, 3.3)] == pytest.approx(
        [0.0, 2.5 + 0.05, 5.0, 5.0, 2.5 - 0.05, 0.0], abs=0.02
    )


def test_hole_inclusion_and_rising_surface() -> None:
    cell = moving_cell()
    cell.robot.motion.halt(T0 + 1.3)
    before = force(cell, 2.0)
    cell.inject("surface", "hard", T0 + 2.0, factor=4.0, for_s=0.5)
    assert force(cell, 2.3) == pytest.approx(4.0 * before)
    cell.inject("surface", "rises", T0 + 3.0, mm_s=2.0, for_s=0.5)
    assert force(cell, 3.6) == pytest.approx(before + 5.0)
    cell.inject("surface", "hole", T0 + 3.6, for_s=0.3)
    assert force(cell, 3.8) == 0.0


def test_obstacle_pushes_down_while_active() -> None:
    cell = s3_jr3_cell(PaperCellProfile(obstacle=ObstacleProfile(5.0, 2000.0)), T0, seed=3)
    cell.robot.motion.enqueue(Waypoint((0.9, -0.1, 0.606), DOWN, 0.01), T0)
    assert force(cell, 0.3) == 0.0
    assert force(cell, 2.0) == pytest.approx(-2.0, abs=0.15)
    cell.inject("obstacle", "above", T0 + 2.0, height_mm=0.0, stiffness_n_m=1e4, for_s=1.0)
    cell.robot.motion.enqueue(Waypoint((0.9, -0.1, 0.607), DOWN, 0.01), T0 + 2.0)
    assert force(cell, 2.9) == pytest.approx(-4.0 - 10.0, abs=1.0)
    assert force(cell, 3.1) == pytest.approx(-4.0, abs=0.15)


# --- reported pose


def status_at(cell: PaperCell, at: float) -> Any:
    return cell.robot._executive.status(T0 + at)


def test_false_position_does_not_move_arm() -> None:
    cell, true = moving_cell(), moving_cell()
    cell.inject("pose", "offset", T0 + 0.5, x_mm=1000.0, for_s=0.5)
    assert status_at(cell, 0.4).position == status_at(true, 0.4).position
    assert status_at(cell, 0.6).position[0] - status_at(true, 0.6).position[0] == pytest.approx(1.0)
    assert status_at(cell, 1.0) == status_at(true, 1.0), "its end is excluded"
    assert cell.true_state(T0 + 0.9).position == true.true_state(T0 + 0.9).position
    far = cell.inject("pose", "offset", T0 + 1.1, x_mm=2000.0, y_mm=-2000.0, z_mm=2000.0)
    cell.inject("pose", "offset", T0 + 1.1, x_mm=2000.0)
    assert status_at(cell, 1.2).position[0] == pytest.approx(4.095875), "as far as a word can tell"
    assert far.struck == 1


def test_pose_faults_mirror_freeze_delay_and_turn() -> None:
    cell, true = moving_cell(), moving_cell()
    start = status_at(true, 0.5).position[2]
    cell.inject("pose", "mirrored", T0 + 0.5, axis="z", for_s=0.5)
    assert status_at(cell, 0.9).position[2] - start == pytest.approx(start - status_at(true, 0.9).position[2])
    cell.inject("pose", "frozen", T0 + 1.0, for_s=0.5)
    assert status_at(cell, 1.4).position == status_at(true, 1.0).position
    cell.inject("pose", "late", T0 + 1.5, ms=300.0, for_s=0.5)
    assert status_at(cell, 1.9).position == status_at(true, 1.6).position
    cell.inject("pose", "turned", T0 + 2.0, degrees=90.0, axis="x", for_s=0.5)
    half = math.sqrt(0.5)
    assert status_at(cell, 2.1).quaternion == pytest.approx((-half, half, 0.0, 0.0), abs=1e-4)
    cell.inject("robot", "false-standby", T0 + 2.5)
    assert (status_at(cell, 2.6).standby, status_at(cell, 2.6).operation) == (True, False)


# --- wires


def wire(pieces: Any, *faults: str, **parameters: object) -> tuple[BadWire, Any]:
    bad = BadWire(pieces, 5)
    ledger = Ledger({WIRE: pieces.faults})
    ledger.attach(WIRE, bad.handlers)
    return bad, next(iter([ledger.inject(WIRE, fault, T0, parameters) for fault in faults]))


DATA = bytes(range(256)) * 4


@pytest.mark.parametrize(
    ("fault", "left"),
    [("off", 0), ("lost", 512), ("twice", 1536), ("corrupted", 1024), ("garbled", 1024)],
)
def test_wire_faults_alter_bytes(fault: str, left: int) -> None:
    parameters = {} if fault == "off" else {"probability": 0.5, "for_s": 2.0}
    bad, injection = wire(BYTES, fault, **parameters)
    out = bad.outgoing(DATA, T0)
    assert len(out) == pytest.approx(left, abs=80)
    assert injection.struck == (1024 if fault == "off" else pytest.approx(512, abs=80))
    assert out != DATA
    assert bad.outgoing(DATA, T0 + 2.0) == DATA, "its end is excluded"
    assert wire(BYTES, fault, **parameters)[0].outgoing(DATA, T0) == out, "repeats with the seed"


def test_delay_keeps_order_and_sets_deadline() -> None:
    bad, _ = wire(BYTES, "late", ms=250.0, for_s=0.1)
    assert bad.outgoing(b"a", T0) == b""
    assert bad.outgoing(b"b", T0 + 0.2) == b"", "never before what went out earlier"
    assert bad.endpoint.next_deadline() == T0 + 0.25
    assert bad.outgoing(b"", T0 + 0.25) == b"ab"
    assert bad.endpoint.next_deadline() is None


def test_fault_of_one_direction_affects_next_frames() -> None:
    frames = [CanFrame(0x100 + k, bytes([k])) for k in range(5)]
    bad, _ = wire(FRAMES, "deaf")
    assert (list(bad.incoming(frames, T0)), list(bad.outgoing(frames, T0))) == ([], frames)
    bad, _ = wire(FRAMES, "mute")
    assert (list(bad.incoming(frames, T0)), list(bad.outgoing(frames, T0))) == (frames, [])
    bad, injection = wire(FRAMES, "lost", probability=1.0, count=7, way="from")
    assert list(bad.outgoing(frames, T0)) == []
    assert list(bad.outgoing(frames, T0 + 1.0)) == frames[2:]
    assert (injection.struck, injection.ended_at) == (7, T0 + 1.0)
    bad, _ = wire(FRAMES, "corrupted", probability=1.0)
    for sent, come in zip(frames, bad.outgoing(frames, T0), strict=True):
        assert sent.identifier == come.identifier
        assert (sent.data[0] ^ come.data[0]).bit_count() == 1


def test_byte_line_has_no_malformed_or_reordered_fault() -> None:
    for fault in ("malformed", "reordered"):
        with pytest.raises(
            ValueError, match=f"^unknown fault '{fault}' for target 'wire'; known: off, mute, [^\n]+$"
        ):
            wire(BYTES, fault)
        assert wire(FRAMES, fault)


def test_two_wire_faults_act_in_sequence() -> None:
    sent = [bytes([k]) * 4 for k in range(4)]
    bad, _ = wire(DATAGRAMS, "twice", "reordered", probability=1.0, way="from")
    assert bad.outgoing(sent[:1], T0) == [sent[0], sent[0]]
    bad, _ = wire(DATAGRAMS, "reordered", "malformed", way="from")
    assert bad.outgoing(sent, T0) == [one[:2] for one in (sent[1], sent[0], sent[3], sent[2])]


def test_held_back_packet_arrives_after_fault() -> None:
    sent = [bytes([k]) * 4 for k in range(3)]
    bad, _ = wire(DATAGRAMS, "reordered", way="from", for_s=0.1)
    assert bad.outgoing(sent[:1], T0) == []
    assert bad.outgoing(sent[1:], T0 + 0.1) == [sent[1], sent[0], sent[2]]


# --- the ledger


def test_ledger_lists_times_and_counts() -> None:
    cell = moving_cell()
    messages: list[str] = []
    cell.ledger.on_fault = lambda news: messages.append(news.text)
    cell.inject("signal", "dead", T0 + 1.0, axis="fx", for_s=0.5)
    cell.inject("robot", "motors-off", T0 + 1.1)
    cell.inject("wire", "drop-ack", T0 + 1.2)
    assert cell.ledger.next_deadline() == T0 + 1.5
    assert cell.ledger.active(T0 + 1.4) == ("signal: dead", "wire: drop-ack")
    cell.ledger.handle_deadline(T0 + 1.6)
    assert cell.ledger.next_deadline() is None
    assert [(item.target, item.fault, item.injected_at, item.ended_at) for item in cell.faults] == [
        ("signal", "dead", T0 + 1.0, T0 + 1.5),
        ("robot", "motors-off", T0 + 1.1, T0 + 1.1),
        ("wire", "drop-ack", T0 + 1.2, None),
    ]
    assert messages == [
        "signal: dead (axis fx) begins for 0.5 s",
        "robot: motors-off happens",
        "wire: drop-ack (of block, count 1) begins",
        "signal: dead ends",
    ]


@pytest.mark.parametrize(
    ("receiver", "target", "fault"),
    [
        (GATEWAY, "bus", "off"),
        (GATEWAY, "computer", "pause"),
    ],
)
def test_unsupported_fault_is_refused(receiver: Receiver, target: str, fault: str) -> None:
    cell = s3_jr3_cell(PaperCellProfile(), T0, 1, receiver=receiver)
    with pytest.raises(ValueError, match=f"^this cell cannot have {target}: {fault}; [^\n]+$"):
        cell.inject(target, fault, T0)
    cell.inject("sensor", "wrong-scales", T0)


def test_polled_board_has_no_stream_faults() -> None:
    cell = s3_jr3_cell(PaperCellProfile(), T0, 1, receiver=BOARD)
    with pytest.raises(ValueError, match=r"^unknown target 'sensor-wire'; known: robot, [^\n]+$"):
        cell.inject("sensor-wire", "lost", T0)


@pytest.mark.parametrize("receiver", [GATEWAY, UART])
def test_gateway_has_no_second_sensor_fault(receiver: Receiver) -> None:
    cell = s3_jr3_cell(PaperCellProfile(), T0, 1, receiver=receiver)
    with pytest.raises(ValueError, match=r"^unplugged: sensor must be first, got 'second'$"):
        cell.inject("sensor", "unplugged", T0, sensor="second")
    cell.inject("sensor", "unplugged", T0)


def test_oversized_second_sensor_is_refused() -> None:
    sensor = SensorProfile(full_scales_n=(5000.0, 5000.0, 5000.0), full_scales_nm=(500.0, 500.0, 500.0))
    profile = PaperCellProfile(sensor=sensor, board=BoardProfile(units=3))
    cell = s3_jr3_cell(profile, T0, 1, receiver=BOARD)
    with pytest.raises(ValueError, match=r"^full scale of fx is 0\.07[^\n]+: choose other units$"):
        cell.inject("sensor", "unplugged", T0, sensor="second")


def test_number_of_faults_per_cell_is_limited() -> None:
    cell = moving_cell()
    for _ in range(INJECTION_LIMIT):
        cell.inject("wire", "babble", T0, count=1)
    with pytest.raises(ValueError, match=r"^this cell has had 1000 faults; start it again$"):
        cell.inject("wire", "babble", T0)
    assert len(cell.faults) == INJECTION_LIMIT


# --- the count of what a fault struck


def test_stuck_signal_counts_changed_samples() -> None:
    signal, ledger = Signal(100.0, "", lambda number: None), Ledger({"signal": SIGNAL_FAULTS})
    ledger.attach("signal", signal.handlers)
    injection = ledger.inject("signal", "stuck", 1.0, {"for_s": 0.06})
    samples = np.tile(np.array([0.0, 5.0, 5.0, 5.0, 6.0, 7.0, 5.0, 8.0]), (6, 1))
    signal.output(samples, 99)
    assert samples[2].tolist() == [0.0, 5.0, 5.0, 5.0, 5.0, 5.0, 5.0, 8.0], "from number 100 to 105"
    assert injection.struck == 2
