"""The panel of the robot of an emulated cell, on its socket."""

from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from typing import Any

from emulators.cell import Cell
from emulators.panel import Controls, Panel
from hil_bridge.clock import Clock
from hil_bridge.devices.panel.server import PanelServer


@asynccontextmanager
async def serve_panel(
    cell: Cell[Any, Any], controls: Controls, url: str, clock: Clock, wake: Callable[[], None]
) -> AsyncIterator[str]:
    """Let the panel listen on a URL; where it is asked. `wake` wakes the cell's devices after each request.

    Raises ConfigError for the URL, TransportUnavailable for the port.
    """
    panel = Panel(cell.robot, controls, cell.ledger)

    def perform(request: Mapping[str, Any]) -> Mapping[str, Any]:
        try:
            return panel.perform(request, clock.now())
        finally:
            wake()

    server = PanelServer(perform, clock)
    address = await server.listen(url)
    try:
        yield address
    finally:
        await server.aclose()
