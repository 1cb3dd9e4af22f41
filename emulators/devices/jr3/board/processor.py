"""Program of the board, except its timing: commands, settings, identification of the sensor."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from emulators.devices.jr3.board.bursts import BurstReader
from emulators.devices.jr3.board.data_path import PathSettings, PathState, initial_state
from emulators.devices.jr3.board.memory import Memory, Use, use_of
from emulators.devices.jr3.board.profile import BoardProfile, SecondSensorProfile
from emulators.devices.jr3.board.sampling import RawSamples, Sampling
from emulators.devices.jr3.board.traces import COLUMNS, NEWEST
from emulators.devices.jr3.board.transforms import Scaling, vectors
from emulators.devices.jr3.board.watch import WATCHED
from emulators.devices.jr3.sensor import Jr3Sensor, SensorProfile
from protocol.devices.jr3 import AXES
from protocol.devices.jr3.board import (
    COMMAND_ERROR,
    COMMANDS,
    MEMORY_WORDS,
    REGISTERS,
    SLOTS,
    UNIT_SCALES,
    WORD_MODULUS,
    CommandCode,
    CommandInfo,
    Errors,
    LoadEnvelope,
    Units,
    VectorAxes,
    command_info,
    decode_envelope,
    decode_transform,
    to_signed,
)
from protocol.endpoint import RemoteProtocolError

_MM = 1e-3


@dataclass(frozen=True, slots=True)
class Order:
    """Command in progress."""

    info: CommandInfo
    argument: int = 0
    word1: int = 0
    word2: int = 0
    scaling: Scaling | None = None
    """Scaling after the command, if the command changes it."""
    failed: bool = False

    @property
    def busy(self) -> bool:
        """Whether no data is computed during the command."""
        return self.info.busy and not self.failed


def default_full_scales(profile: BoardProfile, sensor: SensorProfile) -> tuple[int, ...]:
    """Return a sensor's full scales as words in the board's units. Raises ValueError if a word cannot hold one of
    them.
    """
    unit = UNIT_SCALES[Units(profile.units)]
    forces = [value / unit.force for value in sensor.full_scales_n]
    moments = [value / unit.moment for value in sensor.full_scales_nm]
    words = tuple(round(value) for value in (*forces, *moments))
    for axis, word, value in zip(AXES, words, (*forces, *moments), strict=True):
        if not 1 <= word < WORD_MODULUS // 2:
            raise ValueError(
                f"full scale of {axis} is {value:.3g} in units {profile.units}: choose other units"
            )
    return words


class Processor:
    """Program of the board since its last reset."""

    def __init__(self, profile: BoardProfile, sensor: Jr3Sensor, raw: RawSamples, origin: int) -> None:
        self._profile = profile
        self._sensor = sensor
        self.memory = Memory(profile.channels, profile.idle_hz)
        self._bursts = BurstReader(self.memory)
        self.sampling = Sampling(raw, origin, initial_state())
        self._offset_slots = [(0,) * len(AXES)] * SLOTS
        self._bits = sensor.profile.adc_bits
        self._scaling = Scaling(
            sensor.calibration,
            self._bits,
            UNIT_SCALES[Units(profile.units)],
            profile.turn == "load",
            default_full_scales(profile, sensor.profile),
            span=profile.full_scale_span,
        )
        self._identified: tuple[int, ...] = ()
        """Last identity with a valid checksum, as reported by the sensor; empty before the first."""
        put = self.memory.put
        put("copyright", *(ord(character) << 8 for character in profile.copyright))
        put("vect_axes", profile.vect_axes)
        put("peak_address", profile.peak_address)
        put("rate_address", profile.rate_address)
        put("rate_divisor", profile.rate_divisor)
        put("near_sat_value", profile.near_sat_value)
        put("sat_value", sensor.profile.saturation_counts)
        put("software_ver", profile.software_ver, profile.software_day, profile.software_year)
        self.settings = self._path_settings()

    # --- the sensor

    def forget_sensor(self) -> None:
        """Discard the calibration: a sensor has begun to send, and its calibration is not known yet."""
        for name in ("serial_no", "model_no"):
            self.memory.put(name, 0)
        self.memory.put("last_crc", -1)

    def identify_sensor(self, second: SecondSensorProfile | None = None) -> None:
        """Identify the first or the second sensor, whose calibration has been read. Offsets and peaks are reset.

        A sensor other than the previous one is reported by `sensor changed`. Observed: the same sensor is not
        reported again. Assumed: transform and full scales set by the host remain in force with another sensor, and
        the filters start from 0.
        """
        profile, put = self._profile, self.memory.put
        whose = profile if second is None else second
        full_scales = default_full_scales(profile, self._sensor.profile)
        identity = (whose.serial_no, whose.model_no, whose.cal_day, whose.cal_year)
        if self._identified not in ((), (*identity, *full_scales)):
            self.memory.status |= int(Errors.SENSOR_CHANGE)
        self._identified = (*identity, *full_scales)
        self._scaling = replace(self._scaling, calibration=self._sensor.calibration)
        put("default_fs", *full_scales)
        put("last_crc", 0)
        put("eeprom_ver", profile.eeprom_ver)
        put("serial_no", *identity)
        put("units", profile.units, self._bits, profile.channels)
        put("thickness", round(profile.thickness_mm * _MM / self._scaling.units.length))
        put("offsets", *[0] * len(AXES))
        self._write_scaling()
        state, fresh = self.sampling.cut(), initial_state()
        for name in NEWEST:
            if name.startswith("count"):
                fresh.last[NEWEST[name]] = state.last[NEWEST[name]]
        self.sampling.resume(replace(fresh, sampled=state.sampled))
        self.adopt()

    def lose_sensor(self, zero: bool) -> None:
        """Handle the loss of the sensor: saturation ends, and the data remains unchanged or becomes 0."""
        state = self.sampling.cut()
        last = state.last.copy()
        for name in NEWEST:
            if name in ("errors", "warnings") or (
                zero and name.startswith(("axes", "vectors", "raw", "rate"))
            ):
                last[NEWEST[name]] = 0
        self.sampling.resume(replace(state, last=last))

    def zero_offsets(self) -> None:
        """Set the offsets so that the current data becomes 0."""
        data = self._words("filter2")
        self.memory.put("offsets", *_saturated(self.memory.get("offsets"), data))
        self.adopt()

    # --- words

    def read(self, address: int, count: int) -> list[int]:
        """Return words at the current time."""
        return self.memory.read(address, count, self.sampling.block, self.sampling.sample)

    def burst(self, address: int, count: int) -> bytes:
        """Return words at the current time, as big-endian bytes."""
        return self._bursts.read(address, count, self.sampling.block, self.sampling.sample)

    def write(self, address: int, word: int) -> Use:
        """Accept a word from the host. The caller handles actions that take time or have to wait for a sample."""
        use, memory = use_of(address), self.memory
        match use:
            case Use.IGNORE:
                pass
            case Use.ERRORS:
                memory.status &= ~int(Errors.SENSOR_CHANGE) | word
            case Use.RATE_COUNT:
                self.sampling.resume(replace(self.sampling.cut(), rate_count=word))
            case Use.THRESHOLD_BITS:
                self._set_last("threshold_bits", word)
            case _:
                memory.store(address, word)
        return use

    def adopt(self) -> None:
        """Apply the words that are now in the memory to the computation."""
        state = self.sampling.cut()
        before, self.settings = self.settings, self._path_settings()
        if before.rate_address != self.settings.rate_address:
            state = replace(state, rate_values=None)
        if before.peak_address != self.settings.peak_address:
            # Assumed: the peaks of other words do not apply to these words.
            state = _without_peaks(state)
        self.sampling.resume(state)

    def _words(self, name: str) -> tuple[int, ...]:
        """Return the computed words of the six axes, as signed numbers."""
        register = REGISTERS[name]
        return register.values(self.read(register.address, len(AXES)))

    def _set_last(self, trace: str, word: int) -> None:
        state = self.sampling.cut()
        last = state.last.copy()
        last[NEWEST[trace]] = to_signed(word)
        self.sampling.resume(replace(state, last=last))

    # --- commands

    def begin(self) -> tuple[Order, float]:
        """Begin the command in the memory. Return the command's duration, s."""
        word2, word1, word0 = self.memory.words[
            REGISTERS["command_word2"].address : REGISTERS["command_word0"].address + 1
        ]
        order = self._order(word0, word1, word2)
        info = order.info
        seconds = info.typical if self._profile.command_times == "typical" else info.maximum
        if order.busy:
            self.memory.status |= int(Errors.SYSTEM_BUSY)
            self.sampling.cut()
            seconds += info.per_link * len(order.scaling.links if order.scaling else ())
        return order, seconds

    def finish(self, order: Order) -> None:
        """Complete a command, and write the result to command_word0."""
        if order.busy:
            self.memory.status &= ~int(Errors.SYSTEM_BUSY)
        failed = order.failed
        if not failed:
            try:
                _EFFECTS[order.info.code](self, order)
            except RemoteProtocolError:
                failed = True
        self.memory.put("command_word0", COMMAND_ERROR if failed else 0)

    def _order(self, word0: int, word1: int, word2: int) -> Order:
        if (found := command_info(word0)) is None:
            # Assumed: refusing an unknown command takes as long as the fastest command.
            return Order(COMMANDS[CommandCode.MEMORY_READ], failed=True)
        info, argument = found
        order = Order(info, argument, word1, word2)
        try:
            match info.code:
                case CommandCode.USE_TRANSFORM:
                    links = decode_transform(self.memory.slots(f"transform{argument}"))
                    return replace(order, scaling=replace(self._scaling, links=links))
                case CommandCode.SET_FULL_SCALES:
                    scales = self.memory.get("full_scale")[: len(AXES)]
                    if min(scales) < 1:
                        return replace(order, failed=True)
                    return replace(order, scaling=replace(self._scaling, full_scales=scales))
        except RemoteProtocolError:
            return replace(order, failed=True)
        return order

    def _memory_command(self, order: Order) -> None:
        address = order.word1
        if address >= MEMORY_WORDS:
            raise RemoteProtocolError(f"no word at {address:#06x}")
        old = self.read(address, 1)[0]
        match order.info.code:
            case CommandCode.MEMORY_WRITE:
                new = order.word2
            case CommandCode.BIT_SET:
                new = old | order.word2
            case CommandCode.BIT_RESET:
                new = old & ~order.word2
            case _:
                new = old
        if order.info.code is not CommandCode.MEMORY_READ:
            use = self.write(address, new)
            if use is Use.IGNORE:
                raise RemoteProtocolError(f"the word at {address:#06x} is read-only for the host")
            if use is Use.ADOPT:
                self.adopt()
        self.memory.put("command_word2", old)

    def _change_scaling(self, order: Order) -> None:
        if order.scaling is None:
            return
        offsets = self._scaling.offsets_in(order.scaling, self.memory.get("offsets"))
        self._scaling = order.scaling
        self.memory.put("offsets", *offsets)
        if order.info.code is CommandCode.USE_TRANSFORM:
            self.memory.put("transform_num", order.argument)
        self._write_scaling()
        self.sampling.resume(_without_peaks(self.sampling.cut()))
        self.adopt()

    def _use_offset(self, order: Order) -> None:
        self.memory.put("offsets", *self._offset_slots[order.argument])
        self.memory.put("offset_num", order.argument)
        self.adopt()

    def _set_offsets(self, _order: Order) -> None:
        self._offset_slots[self.memory.value("offset_num")] = self.memory.get("offsets")

    def _reset_offsets(self, _order: Order) -> None:
        self.zero_offsets()

    def _vector_axes(self, order: Order) -> None:
        self.memory.put("vect_axes", order.argument)
        self._write_scaling()
        self.adopt()

    def _peaks(self, order: Order) -> None:
        state = self.sampling.cut()
        if state.minimum is not None and state.maximum is not None:
            self.memory.put("minimum", *state.minimum.tolist(), *state.maximum.tolist())
        if order.info.code is CommandCode.READ_AND_RESET_PEAKS:
            self.sampling.resume(_without_peaks(state))

    # --- settings

    def _write_scaling(self) -> None:
        """Write the words that are derived from transform, full scales and vector axes."""
        _, lengths = vectors(VectorAxes(self.memory.value("vect_axes")), self._scaling.full_scales)
        self.memory.put("full_scale", *self._scaling.full_scales, *lengths)
        smallest, largest = self._scaling.recommended
        self.memory.put("min_full_scale", *smallest)
        self.memory.put("max_full_scale", *largest)

    def _path_settings(self) -> PathSettings:
        memory, scaling = self.memory, self._scaling
        envelope = self._envelope()
        peak, rate = memory.value("peak_address"), memory.value("rate_address")
        addresses = [
            *range(peak, peak + WATCHED),
            *range(rate, rate + WATCHED),
            *(item.data_address for item in (*envelope.at_least, *envelope.at_most)),
        ]
        return PathSettings(
            scaling.counts_per_raw,
            scaling.too_small,
            np.array(memory.get("offsets"), np.float64),
            vectors(VectorAxes(memory.value("vect_axes")), scaling.full_scales)[0],
            memory.value("near_sat_value"),
            memory.value("sat_value"),
            peak,
            rate,
            memory.value("rate_divisor") or WORD_MODULUS,
            envelope,
            {a: to_signed(memory.words[a]) for a in addresses if a < MEMORY_WORDS and a not in COLUMNS},
        )

    def _envelope(self) -> LoadEnvelope:
        """Return the load envelope in use. Assumed: an invalid envelope compares nothing."""
        number = self.memory.value("load_envelope_num")
        if number not in range(SLOTS):
            return LoadEnvelope()
        try:
            return decode_envelope(self.memory.slots(f"load_envelope{number}"))
        except RemoteProtocolError:
            return LoadEnvelope()


def _without_peaks(state: PathState) -> PathState:
    return replace(state, minimum=None, maximum=None)


def _saturated(offsets: tuple[int, ...], data: tuple[int, ...]) -> list[int]:
    return [min(max(offset + value, -32768), 32767) for offset, value in zip(offsets, data, strict=True)]


_EFFECTS: dict[CommandCode, Callable[[Processor, Order], None]] = {
    CommandCode.MEMORY_READ: Processor._memory_command,
    CommandCode.MEMORY_WRITE: Processor._memory_command,
    CommandCode.BIT_SET: Processor._memory_command,
    CommandCode.BIT_RESET: Processor._memory_command,
    CommandCode.USE_TRANSFORM: Processor._change_scaling,
    CommandCode.USE_OFFSET: Processor._use_offset,
    CommandCode.SET_OFFSETS: Processor._set_offsets,
    CommandCode.RESET_OFFSETS: Processor._reset_offsets,
    CommandCode.VECTOR_AXES: Processor._vector_axes,
    CommandCode.SET_FULL_SCALES: Processor._change_scaling,
    CommandCode.READ_AND_RESET_PEAKS: Processor._peaks,
    CommandCode.READ_PEAKS: Processor._peaks,
}
