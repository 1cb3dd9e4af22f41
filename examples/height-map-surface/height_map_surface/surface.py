"""Surface with heights from a file and hil-bridge's own contact model."""

import math
from dataclasses import dataclass

from emulators.faults.kinds import Fault
from emulators.seams import SurfaceFactory
from emulators.surface.contact import Contact
from emulators.surface.faults import SURFACE_FAULTS
from emulators.surface.profile import SurfaceKind as OwnShapes
from emulators.surface.profile import SurfaceProfile
from emulators.surface.shapes import HeightMap, Shape
from height_map_surface.heights import from_image, from_stl
from hil_bridge.devices.kinds import SurfaceKind
from protocol.marks import Mark, SettingError, above, setting


@dataclass(frozen=True, slots=True)
class HeightMapProfile(SurfaceProfile):
    """All settings of hil-bridge's own surface with another shape; the settings of its own shapes have no effect."""

    image_file: str = setting(
        "", Mark.CHOSEN, "greyscale PNG; its right is along the path, its top to the left"
    )
    white_mm: float = setting(10.0, Mark.CHOSEN, "height of white above black", above(0.0), unit="mm")
    stl_file: str = setting(
        "", Mark.CHOSEN, "STL file of a part in mm, seen from above; its x is along the path"
    )
    section_mm: tuple[float, ...] = setting(
        (), Mark.CHOSEN, "section x0 y0 x1 y1 of the part; empty for the entire part", unit="mm"
    )
    spacing_mm: float = setting(
        1.0, Mark.CHOSEN, "spacing of the pixels, or of the grid on the part", above(0.0), unit="mm"
    )

    def __post_init__(self) -> None:
        SurfaceProfile.__post_init__(self)
        if self.kind is not OwnShapes.FLAT:
            raise SettingError("kind", "must be left out; the shape comes from image_file or stl_file")
        if self.section_mm and not (
            len(self.section_mm) == 4
            and all(map(math.isfinite, self.section_mm))
            and self.section_mm[0] < self.section_mm[2]
            and self.section_mm[1] < self.section_mm[3]
        ):
            raise SettingError(
                "section_mm", f"must be x0 y0 x1 y1 with x0 < x1 and y0 < y1, got {self.section_mm}"
            )

    def shape(self) -> Shape:
        """Return the shape of the file. Raises ValueError, in one line, for a file that cannot be read."""
        if bool(self.image_file) == bool(self.stl_file):
            raise ValueError("set one of image_file and stl_file")
        if self.image_file:
            heights = from_image(self.image_file, self.white_mm)
        else:
            heights = from_stl(self.stl_file, self.section_mm, self.spacing_mm)
        return HeightMap(self.height_mm / 1000.0, heights, self.spacing_mm / 1000.0)


def make(settings: HeightMapProfile) -> SurfaceFactory:
    """Return hil-bridge's own surface, with its contact, material, friction, wear and faults, in this shape."""
    return lambda changed: Contact(settings, changed)


FAULTS: dict[str, Fault] = dict(SURFACE_FAULTS)
SURFACE = SurfaceKind("height-map", "Heights from an image or an STL file", HeightMapProfile, make, FAULTS)
