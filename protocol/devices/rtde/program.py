"""Our own program for the controller: it takes poses from input registers and servos to them.

Own design. It is uploaded as text to the script port, and lives on the registers from 24 on, which are for external
clients: a fieldbus or ur_rtde on the lower ones is not disturbed. It has not run on a real controller yet.
"""

from enum import IntEnum

NAME = "hil_bridge"
FORCE_NAME = "hil_ft"
"""Name of the program that enables `external_force_torque`."""

POSE, TIME, LOOKAHEAD, GAIN = 24, 30, 31, 32
"""First of six input double registers of the pose, then those of servoj's t, lookahead_time and gain."""
COMMAND, SEQUENCE = 24, 25
"""Input integer registers."""
STATE, TAKEN, AGE = 24, 25, 26
"""Output integer registers: state, last sequence number taken, cycles since then."""

INPUT_NAMES = (
    *(f"input_double_register_{number}" for number in range(POSE, GAIN + 1)),
    f"input_int_register_{COMMAND}",
    f"input_int_register_{SEQUENCE}",
)
"""Input recipe of the client: pose, t, lookahead, gain, command, sequence."""
WATCHED = f"input_int_register_{COMMAND}"
"""The input whose packages keep the program's watchdog quiet."""


class Command(IntEnum):
    """Orders to the program."""

    IDLE = 0
    SERVO = 1
    STOP = 2
    END = 255


class State(IntEnum):
    """Reports of the program."""

    READY = 1
    SERVOING = 2
    STARVED = 3
    """No new target for too long, or told to stop: it has braked."""
    REFUSED = 4
    """No joints near the present ones hold the pose that was asked for."""
    ENDED = 5


def program_text(
    hold_cycles: int, watchdog_hz: float, deceleration_m_s2: float, joint_step_rad: float
) -> str:
    """Return the program's text for the script port.

    Without a new target for `hold_cycles` it brakes, and continues with the next. Without any package for a period of
    `watchdog_hz` the controller stops it. It refuses a pose that no joints within `joint_step_rad` of the last ones
    hold: at the end of its reach an arm would else swing over to another posture.
    """
    return _PROGRAM.format(
        name=NAME,
        watched=WATCHED,
        watchdog=f"{watchdog_hz:g}",
        pose=", ".join(f"read_input_float_register({number})" for number in range(POSE, POSE + 6)),
        hold=hold_cycles,
        brake=f"{deceleration_m_s2:g}",
        step=f"{joint_step_rad:g}",
    )


def force_program_text(hold: bool) -> str:
    """Return the program that makes the controller use `external_force_torque` as its sensor.

    With `hold` it runs until it is stopped. Source of the call: Universal Robots' C++ client library.
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
        j = 0
        while j < 6:
          if norm(n[j] - q[j]) > {step}:
            near = False
          end
          j = j + 1
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
