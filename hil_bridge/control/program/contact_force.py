"""Forces and moments in the work frame, relative to the program's own zero, and on a flat face. Pure."""

from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.state import Course
from hil_bridge.control.geometry.turning import moment_at
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.geometry.work_frame import Face, WorkFrame, along
from hil_bridge.control.sample import Sample
from protocol.geometry import Vector, normalise, rotate


def subtract_zero(
    course: Course, frame: WorkFrame, sample: Sample, force: Vector
) -> tuple[Vector, tuple[float, ...]]:
    """Return the contact force along the approach, x and y, N, and the wrench of a sample, relative to the
    program's zero.
    """
    quaternion = sample.orientation or course.home
    if quaternion is None or len(sample.wrench) != 6:
        return force, sample.wrench
    turned = rotate(normalise(quaternion), course.zero[:3])
    a, t, b = (along(turned, axis) for axis in (frame.approach, frame.x, frame.y))
    wrench = tuple(value - zero for value, zero in zip(sample.wrench, course.zero, strict=True))
    return (force[0] + a, force[1] + t, force[2] + b), wrench


def find_across(frame: WorkFrame, sample: Sample) -> float:
    """Return the contact force along y, N, for a recording that contains it only in the wrench; 0 if unknown."""
    if sample.orientation is None or len(sample.wrench) != 6:
        return 0.0
    return -along(rotate(sample.orientation, sample.wrench[:3]), frame.y)


def measure_skew(
    frame: WorkFrame, face: Face, contact: ContactSample, per_angle: float
) -> tuple[Vector, Place | None]:
    """Return the tool's axis, and the tilt that corrects the skew measured by the moments on its face, in the task
    frame.
    """
    orientation = contact.sample.orientation
    if orientation is None or not per_angle or len(contact.wrench) != 6:
        return (1.0, 0.0, 0.0), None
    quaternion = normalise(orientation)
    axis = rotate(quaternion, (0.0, 0.0, 1.0))
    u, v, _ = moment_at(contact.wrench, face.centre)
    # the tool yields to the moment: a rotation by moment / stiffness tilts the axis
    x, y, z = rotate(quaternion, (v / per_angle, -u / per_angle, 0.0))
    a, t, b = (along(axis, direction) for direction in (frame.approach, frame.x, frame.y))
    return (a, t, b), (along((x, y, z), frame.x), along((x, y, z), frame.y))
