"""Sockets of a program in URScript."""

from collections.abc import Callable

from tests.emulation.urscript_trial import ProgramTrial, output_of, program


class Line:
    """Connection whose other end is a test."""

    opening, open = False, True

    def __init__(self) -> None:
        self.came, self.sent = b"", b""

    def take(self, count: int) -> bytes | None:
        if len(self.came) < count:
            return None
        data, self.came = self.came[:count], self.came[count:]
        return data

    def take_until(self, end: bytes) -> bytes | None:
        at = self.came.find(end)
        if at < 0 or not self.came:
            return None
        return self.take(at + len(end) if end else len(self.came))

    def send(self, data: bytes) -> bool:
        self.sent += data
        return True

    def hang_up(self) -> None:
        self.open = False


def test_program_reads_and_writes_socket() -> None:
    trial = ProgramTrial(
        program(
            'textmsg(socket_open("10.0.0.1", 50001, "pc"))\nsocket_send_string("hello", "pc")\n'
            'socket_send_int(7, "pc")\ntextmsg(socket_read_binary_integer(2, "pc", 0.01))\n'
            'textmsg(socket_read_binary_integer(1, "pc", 0.01))\ntextmsg(socket_read_line("pc"))\n'
            'textmsg(socket_read_ascii_float(2, "pc"))\nsocket_close("pc")\ntextmsg(socket_send_int(1, "pc"))'
        )
    )
    line = Line()
    opened: list[tuple[str, int]] = []
    serve: Callable[[str, int], Line] = lambda address, port: opened.append((address, port)) or line  # type: ignore[func-returns-value] # noqa: E731
    trial.controller.console.open_socket = serve
    line.came = b"\x00\x00\x00\x01\xff\xff\xff\xff"
    assert trial.play(6) == -1
    line.came += b"word\n(1.5, -2)"
    assert trial.play(50) >= 0
    assert opened == [("10.0.0.1", 50001)]
    assert not line.open
    assert line.sent == b"hello\x00\x00\x00\x07"
    assert trial.messages() == ["True", "[2, 1, -1]", "[0, -1]", "word", "[2, 1.5, -2]", "False"]


def test_server_variable_is_set_and_read() -> None:
    """An answer of another variable, one that is not a number, and none within two seconds count as 0."""
    trial = ProgramTrial(
        program(
            'socket_open("10.0.0.1", 63352)\nsocket_set_var("POS", 255)\n'
            + 'textmsg(socket_get_var("POS"))\n' * 4
        )
    )
    line = Line()
    trial.controller.console.open_socket = lambda address, port: line
    line.came = b"POS 12\nSTA 3\nPOS many\n"
    assert trial.play(1100) >= 1000
    assert line.sent == b"SET POS 255\n" + b"GET POS\n" * 4
    assert trial.messages() == ["12", "0", "0", "0"]


def test_no_socket_opens_without_network() -> None:
    assert output_of(program('textmsg(socket_open("10.0.0.1", 50001))')) == ["False"]
