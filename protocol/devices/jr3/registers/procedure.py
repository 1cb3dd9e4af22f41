"""Steps of a session with a register server: each is a request, and waits for its answer, or a pause."""

from protocol.devices.jr3.registers.startup import BoardIdentity, Load, Read, Step, Steps, Wait, Write
from protocol.devices.jr3.registers.telegrams import Op, Request, encode_request

_TAG_MODULUS = 65536


class RequestWriter:
    """Numbers requests, and keeps them until they are sent."""

    def __init__(self, bursts: int) -> None:
        self._bursts = bursts
        self._out = b""
        self._tag = 0

    def write(
        self,
        op: Op,
        address: int = 0,
        count: int = 0,
        *,
        words: tuple[int, ...] = (),
        period_us: int = 0,
    ) -> int:
        """Write a request; its tag."""
        self._tag = (self._tag + 1) % _TAG_MODULUS
        request = Request(op, self._tag, address, count, words, period_us, self._bursts)
        self._out += encode_request(request)
        return self._tag

    def take(self) -> bytes:
        """Return the bytes to be sent."""
        data, self._out = self._out, b""
        return data


class Procedure:
    """The steps that are under way, if any."""

    def __init__(self, writer: RequestWriter, answer_timeout: float) -> None:
        """`answer_timeout` is the patience with the server, s."""
        self._writer, self._answer_timeout = writer, answer_timeout
        self.drop()

    def drop(self) -> None:
        """Give up the steps."""
        self._steps: Steps[BoardIdentity | None] | None = None
        self.step: Step | None = None
        """The step under way."""
        self.tag: int | None = None
        """Tag of the request whose answer it waits for."""
        self.wake_at: float | None = None
        """End of a pause, s."""
        self.answer_by: float | None = None
        """End of the patience with the server, s."""

    @property
    def runs(self) -> bool:
        """Whether there are steps."""
        return self._steps is not None

    def begin(self, steps: Steps[BoardIdentity | None], now: float) -> None:
        """Take the first of these steps. Raises StopIteration and RemoteProtocolError as `advance`."""
        self.drop()
        self._steps = steps
        self.advance((), now)

    def advance(self, words: tuple[int, ...], now: float) -> None:
        """Take the next step; `words` answer the one before. Raises StopIteration with the result after the last one,
        and RemoteProtocolError for words that are not expected.
        """
        steps = self._steps
        assert steps is not None
        self.tag = self.wake_at = self.answer_by = None
        self.step = step = next(steps) if self.step is None else steps.send(words)
        match step:
            case Wait(duration):
                self.wake_at = now + duration
                return
            case Read(address, count):
                self.tag = self._writer.write(Op.READ, address, count)
            case Write(address, values):
                self.tag = self._writer.write(Op.WRITE, address, len(values), words=values)
            case Load(address, words):
                self.tag = self._writer.write(Op.PROGRAM, address, len(words), words=words)
            case _:
                self.tag = self._writer.write(Op.RESET)
        self.wait_for_answer(now)

    def wait_for_answer(self, now: float) -> None:
        """Start the server's time-out."""
        self.answer_by = now + self._answer_timeout
