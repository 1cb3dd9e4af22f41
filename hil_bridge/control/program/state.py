"""State of a program between samples."""

from msgspec import Struct

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.state import Course, StepState


class ProgramState(Struct, frozen=True, gc=False):
    """State of a program: the part of the program itself, and the part of its step."""

    course: Course = Course()
    step: StepState = StepState()

    @property
    def phase(self) -> Phase:
        """Phase of the run."""
        return self.step.stroke.phase

    @property
    def in_contact(self) -> bool:
        """Whether the tool is considered to be in contact."""
        return self.step.stroke.in_contact
