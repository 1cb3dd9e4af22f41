"""The architecture pictures show existing rooms and imports."""

import grimp
import pytest

from tools.room_pictures import ARROWS, PATH, ROOMS, Arrow, Box


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph("hil_bridge", "emulators", "protocol", cache_dir=None)


def test_room_picture_boxes_name_existing_modules(graph: grimp.ImportGraph) -> None:
    named = [module for box in (*ROOMS.values(), *PATH) for module in box.modules]
    assert [module for module in named if module not in graph.modules] == []


def imports(graph: grimp.ImportGraph, source: Box, target: Box) -> int:
    """Return the imports from modules of one box to modules of the other."""
    inside = {part for module in target.modules for part in (module, *graph.find_descendants(module))}
    return sum(
        len(graph.find_modules_directly_imported_by(part) & inside)
        for module in source.modules
        for part in (module, *graph.find_descendants(module))
    )


@pytest.mark.parametrize("arrow", ARROWS, ids=lambda arrow: f"{arrow.source}-{arrow.target}")
def test_room_picture_arrows_match_imports(arrow: Arrow, graph: grimp.ImportGraph) -> None:
    links = imports(graph, ROOMS[arrow.source], ROOMS[arrow.target])
    if arrow.dashed:
        assert links == 0  # by name, at run time
    else:
        assert links > 0
        assert imports(graph, ROOMS[arrow.target], ROOMS[arrow.source]) == 0, "the arrow has a reverse import"
