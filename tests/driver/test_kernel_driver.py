"""Linux's own jr3_pci driver, from Debian's kernel package, starts the emulated board and reads its sensor.

The tests share one driver and run in order: right after its start it polls the sensor soon, later every 10 s.
"""

import errno
import os
import statistics
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from emulators.devices.jr3 import Board
from tests.driver.comedi import Comedi
from tests.driver.jr3_window import Window, mapped
from tests.paper_cell import BOARD, PaperCellProfile, s3_jr3_cell

pytestmark = pytest.mark.driver

INSIDE = "HIL_BRIDGE_MACHINE"
DEVICES, DRIVER = Path("/sys/bus/pci/devices"), Path("/sys/bus/pci/drivers/jr3_pci")
STAND_IN = "1234 1111"
"""Vendor and device number of the PCI device whose memory contains the board's words."""
FIRMWARE_PATH = Path("/sys/module/firmware_class/parameters/path")
NO_PROGRAM = "ffff\n"
"""The driver's program file with only its end mark: the emulated board needs no program."""
CHANNELS_OF_A_FILTER = 8
FILTER = 0
"""Chosen: the noise of unfiltered data shows that every read returns new data."""
FX, FY, FZ, MX, MY, MZ = range(6)
MODEL_CHANNEL, SERIAL_CHANNEL = 56, 57
UNIT = 1e-3
"""N and N·m of the driver's millionths: its ranges are in kN and kN·m."""
GRAVITY = 9.80665
READS = 2000
START_S = 30.0
"""Time limit of the driver's start, or of its return to a sensor, s: it polls once a second, at first up to 10 s late,
eleven times.
"""


@dataclass(frozen=True, slots=True)
class DrivenBoard:
    """Board with its driver, and a program that reads it."""

    window: Window
    card: Comedi
    profile: PaperCellProfile

    def started(self) -> float:
        """Wait until the driver has data, and return how long that took, s."""
        began = time.monotonic()
        while not self.has_data():
            if time.monotonic() > began + START_S:
                pytest.fail(f"the driver has no data after {START_S} s; it gave {self.window.commands}")
            time.sleep(0.1)
        return time.monotonic() - began

    def wrench(self, filter_number: int) -> list[float]:
        """Return the six axes of a filter, N and N·m."""
        first, spans = CHANNELS_OF_A_FILTER * filter_number, self.card.spans()
        return [spans[at].value(self.card.read(at)) * UNIT for at in range(first, first + 6)]

    def has_data(self) -> bool:
        """Return whether a program gets data, not EAGAIN."""
        try:
            self.card.read(MODEL_CHANNEL)
        except OSError as error:
            if error.errno != errno.EAGAIN:
                raise
            return False
        return True


def _stand_in() -> Path:
    for device in sorted(DEVICES.iterdir()):
        if " ".join((device / name).read_text().strip()[2:] for name in ("vendor", "device")) == STAND_IN:
            return device
    pytest.fail(f"this machine has no PCI device {STAND_IN}")


@pytest.fixture(scope="session")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DrivenBoard]:
    """Yield a board with a newly bound driver; the cell's tool hangs from the sensor."""
    if not os.environ.get(INSIDE):
        pytest.skip("needs a machine of its own: `make kernel-driver` runs it")
    profile = PaperCellProfile()
    board = s3_jr3_cell(profile, time.monotonic(), seed=7, receiver=BOARD).sensor
    assert isinstance(board, Board)
    firmware = tmp_path_factory.mktemp("firmware")
    (firmware / "comedi").mkdir()
    (firmware / "comedi" / "jr3pci.idm").write_text(NO_PROGRAM)
    subprocess.run(["modprobe", "jr3_pci"], check=True)
    FIRMWARE_PATH.write_text(str(firmware))
    device = _stand_in()
    (device / "enable").write_text("1")
    with Window(board, mapped(device / "resource0")) as window:
        (DRIVER / "new_id").write_text(STAND_IN)
        try:
            with Comedi(Path("/dev/comedi0")) as card:
                yield DrivenBoard(window, card, profile)
        finally:
            (DRIVER / "unbind").write_text(device.name)


def print_line(capsys: pytest.CaptureFixture[str], text: str) -> None:
    """Write a line into the log, even if the test passes."""
    with capsys.disabled():
        print(f"\n    {text}", end="", flush=True)


def test_driver_starts_board(driven: DrivenBoard, capsys: pytest.CaptureFixture[str]) -> None:
    assert not driven.has_data()
    seconds = driven.started()
    card, sensor, board = driven.card, driven.profile.sensor, driven.profile.board
    model, serial = card.read(MODEL_CHANNEL), card.read(SERIAL_CHANNEL)
    spans = card.spans()
    print_line(capsys, f"driver {card.driver}, board {card.board}, {card.channels} channels")
    print_line(capsys, f"data after {seconds:.1f} s, resets {driven.window.resets}")
    print_line(capsys, f"commands {' '.join(f'{code:04X}' for code in driven.window.commands)}")
    print_line(capsys, f"model {model}, serial {serial}")
    ranges = [span.most * UNIT for span in spans[:6]]
    print_line(capsys, "ranges ± {:g} {:g} {:g} N, {:g} {:g} {:g} N·m".format(*ranges))
    assert (card.driver, card.board, card.channels) == ("jr3_pci", "jr3_pci_1", 58)
    assert driven.window.resets == 1
    assert driven.window.commands == [0x0500, 0x0A00, 0x0600, 0x0700]
    assert (model, serial) == (board.model_no, board.serial_no)
    assert ranges == pytest.approx([*sensor.full_scales_n, *sensor.full_scales_nm])
    assert [-span.least for span in spans[:6]] == [span.most for span in spans[:6]]


def test_driver_survives_replugged_sensor(driven: DrivenBoard, capsys: pytest.CaptureFixture[str]) -> None:
    driven.started()
    driven.window.at_board(Board.unplug)
    time.sleep(0.1)
    for channel in (FZ, MODEL_CHANNEL, SERIAL_CHANNEL):
        with pytest.raises(BlockingIOError) as refused:
            driven.card.read(channel)
    assert refused.value.errno == errno.EAGAIN
    print_line(capsys, f"sensor unplugged: {refused.value.strerror} (EAGAIN)")
    driven.window.at_board(Board.plug_in)
    seconds = driven.started()
    print_line(capsys, f"the same sensor plugged in again: data after {seconds:.1f} s")
    time.sleep(1.0)
    weight = driven.profile.tool.mass_kg * GRAVITY
    assert driven.wrench(FILTER) == pytest.approx([0.0, 0.0, weight, 0.0, 0.0, 0.0], abs=0.2)


def test_driver_reads_weight_of_tool(driven: DrivenBoard, capsys: pytest.CaptureFixture[str]) -> None:
    driven.started()
    time.sleep(1.0)  # the filter's settling, after the driver has set the offsets
    weight = driven.profile.tool.mass_kg * GRAVITY
    channel = CHANNELS_OF_A_FILTER * FILTER + FZ
    span = driven.card.spans()[channel]
    began, readings = time.monotonic(), []
    for _ in range(READS):
        readings.append(span.value(driven.card.read(channel)) * UNIT)
        time.sleep(0.0005)
    seconds = time.monotonic() - began
    mean, deviation, values = statistics.fmean(readings), statistics.pstdev(readings), len(set(readings))
    print_line(
        capsys, f"{READS} reads of fz, filter {FILTER}, in {seconds:.2f} s: {values} different values,"
    )
    least, most = min(readings), max(readings)
    print_line(capsys, f"mean {mean:.3f} N, deviation {deviation:.3f} N, {least:.3f} … {most:.3f} N;")
    print_line(capsys, f"the tool weighs {weight:.3f} N")
    wrench = driven.wrench(FILTER)
    print_line(capsys, "fx fy fz mx my mz: " + " ".join(f"{value:.3f}" for value in wrench))
    assert all(abs(reading - weight) < 0.2 for reading in readings)
    assert values > 1
    for filter_number in range(4):
        wrench = driven.wrench(filter_number)
        assert wrench == pytest.approx([0.0, 0.0, weight, 0.0, 0.0, 0.0], abs=0.2)
        assert wrench[MX:] == pytest.approx([0.0] * 3, abs=0.02)
