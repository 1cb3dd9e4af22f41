"""Steps of a session with a register server. Each step is a pause, or a request that waits for its response."""

from protocol.devices.jr3.registers.startup import BoardIdentity, Load, Read, Step, Steps, Wait, Write
from protocol.devices.jr3.registers.telegrams import Op, Request, encode_request

_TAG_MODULUS = 65536


class RequestWriter:
    """Encoder that numbers requests and buffers them until they are sent."""

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
        """Encode a request into the buffer and return its tag."""
        self._tag = (self._tag + 1) % _TAG_MODULUS
        request = Request(op, self._tag, address, count, words, period_us, self._bursts)
        self._out += encode_request(request)
        return self._tag

    def take(self) -> bytes:
        """Return the buffered bytes and empty the buffer."""
        data, self._out = self._out, b""
        return data


class Procedure:
    """Executor of a sequence of steps. At most one sequence is in progress."""

    def __init__(self, writer: RequestWriter, answer_timeout: float) -> None:
        """Create an executor. `answer_timeout` is the time-out for a response of the server, s."""
        self._writer, self._answer_timeout = writer, answer_timeout
        self.drop()

    def drop(self) -> None:
        """Cancel the steps."""
        self._steps: Steps[BoardIdentity | None] | None = None
        self.step: Step | None = None
        """Current step."""
        self.tag: int | None = None
        """Tag of the request whose response is awaited."""
        self.wake_at: float | None = None
        """End of the current pause, s, or None."""
        self.answer_by: float | None = None
        """End of the time-out for the response, s; None if no response is awaited."""

    @property
    def runs(self) -> bool:
        """Whether steps are in progress."""
        return self._steps is not None

    def begin(self, steps: Steps[BoardIdentity | None], now: float) -> None:
        """Start the first step of a sequence. Raises the same exceptions as `advance`."""
        self.drop()
        self._steps = steps
        self.advance((), now)

    def advance(self, words: tuple[int, ...], now: float) -> None:
        """Start the next step. `words` is the response to the previous step.

        Raises StopIteration with the result after the last step, and RemoteProtocolError if the words are
        unexpected.
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
        """Start the time-out for a response."""
        self.answer_by = now + self._answer_timeout
