"""URScript programs, parsed, compiled and executed cycle by cycle on a robot that implements `host.Host`."""

from emulators.devices.rtde.urscript.catalogue import FUNCTIONS, functions_of
from emulators.devices.rtde.urscript.failures import RuntimeFailure, ScriptSyntaxError, SyntaxFailure
from emulators.devices.rtde.urscript.host import ORDERED, Host, Message, Profile, Socket
from emulators.devices.rtde.urscript.machine import Machine
from emulators.devices.rtde.urscript.statements import CompiledProgram, compile_in_steps, compile_program

__all__ = [
    "FUNCTIONS",
    "ORDERED",
    "CompiledProgram",
    "Host",
    "Machine",
    "Message",
    "Profile",
    "RuntimeFailure",
    "ScriptSyntaxError",
    "Socket",
    "SyntaxFailure",
    "compile_in_steps",
    "compile_program",
    "functions_of",
]
