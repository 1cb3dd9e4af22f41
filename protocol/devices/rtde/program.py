"""The bridge's program for the controller. It reads poses from input registers and moves the arm to them with
servoj.

The program is this project's own design. It is uploaded as text to the script port. It uses the registers from 24
on, which are reserved for external clients, so it does not disturb a fieldbus or ur_rtde on the lower registers. It
has not been run on a real controller yet.
"""

from enum import IntEnum

NAME = "hil_bridge"
FORCE_NAME = "hil_ft"
"""Name of the program that enables `external_force_torque`."""

POSE, TIME, LOOKAHEAD, GAIN = 24, 30, 31, 32
"""Numbers of input double registers: the first of six registers for the pose, then the registers for servoj's t,
lookahead_time and gain.
"""
COMMAND, SEQUENCE = 24, 25
"""Numbers of the input integer registers for the command and the sequence number."""
STATE, TAKEN, AGE = 24, 25, 26
"""Numbers of the output integer registers for the state, the last accepted sequence number, and the cycles since
then.
"""

INPUT_NAMES = (
    *(f"input_double_register_{number}" for number in range(POSE, GAIN + 1)),
    f"input_int_register_{COMMAND}",
    f"input_int_register_{SEQUENCE}",
)
"""Names of the variables in the client's input recipe: pose, t, lookahead, gain, command, sequence."""
WATCHED = f"input_int_register_{COMMAND}"
"""Name of the input that the program's watchdog monitors."""


class Command(IntEnum):
    """Command to the program."""

    IDLE = 0
    SERVO = 1
    STOP = 2
    END = 255


class State(IntEnum):
    """State that the program reports."""

    READY = 1
    SERVOING = 2
    STARVED = 3
    """The program has braked, because it got no new target for too long or a stop was commanded."""
    REFUSED = 4
    """No joint angles near the present ones reach the requested pose."""
    ENDED = 5


def program_text(
    hold_cycles: int, watchdog_hz: float, deceleration_m_s2: float, joint_step_rad: float
) -> str:
    """Return the text of the program for the script port.

    Without a new target for `hold_cycles`, the program brakes, and continues with the next target. Without any
    package for a period of `watchdog_hz`, the controller stops the program. The program refuses a pose that no
    joint angles within `joint_step_rad` of the last ones reach; otherwise, an arm at the end of its reach would
    flip to another posture.
    """
    return _PROGRAM.format(
        name=NAME,
        watched=WATCHED,
        watchdog=f"{watchdog_hz:g}",
        pose=", ".join(f"read_input_float_register({number})" for number in range(POSE, POSE + 6)),
        hold=hold_cycles,
        brake=f"{deceleration_m_s2:g}",
        leap=" or ".join(f"norm(n[{joint}] - q[{joint}]) > {joint_step_rad:g}" for joint in range(6)),
    )


def force_program_text(hold: bool) -> str:
    """Return the text of a program that makes the controller use `external_force_torque` as its sensor.

    With `hold`, the program runs until it is stopped. Source of the call: Universal Robots' C++ client library.
    """
    rest = "  while True:\n    sync()\n  end\n" if hold else ""
    return f"def {FORCE_NAME}():\n  ft_rtde_input_enable(True, 0, [0,0,0], [0,0,0])\n{rest}end\n"


_PROGRAM = """\
def {name}():
  rtde_set_watchdog("{watched}", {watchdog}, "stop")
  last = read_input_integer_register(25)
  q = get_target_joint_positions()
  on = False
  age = 0
  write_output_integer_register(25, last)
  write_output_integer_register(24, 1)
  while read_input_integer_register(24) != 255:
    cmd = read_input_integer_register(24)
    seq = read_input_integer_register(25)
    age = age + 1
    if cmd == 1 and seq != last:
      last = seq
      age = 0
      write_output_integer_register(25, seq)
      x = p[{pose}]
      near = get_inverse_kin_has_solution(x, q)
      if near:
        n = get_inverse_kin(x, q)
        if {leap}:
          near = False
        end
      end
      if near:
        q = n
        on = True
        write_output_integer_register(24, 2)
      else:
        write_output_integer_register(24, 4)
        if on:
          stopl({brake})
        end
        on = False
      end
    end
    write_output_integer_register(26, age)
    if on and (cmd != 1 or age > {hold}):
      stopl({brake})
      on = False
      write_output_integer_register(24, 3)
    end
    if cmd != 1:
      write_output_integer_register(24, 1)
    end
    if on:
      servoj(q, t=read_input_float_register(30), lookahead_time=read_input_float_register(31), \
gain=read_input_float_register(32))
    else:
      sync()
    end
  end
  if on:
    stopl({brake})
  end
  write_output_integer_register(24, 5)
end
"""
