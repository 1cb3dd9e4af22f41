"""Pictures as files, drawn by matplotlib, which the extra `figures` brings."""

import io
from typing import TYPE_CHECKING, Any

from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NO_DATE: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None},
    "svg": {"Date": None},
}


def drawing_library() -> Any:
    """The module matplotlib, imported late: it takes most of a second. Raises ConfigError where it is missing."""
    try:
        import matplotlib
    except ImportError:
        raise ConfigError(
            f"pictures as files need matplotlib: {install_command('figures')}, or leave them out"
        ) from None
    return matplotlib


def save_figure(figure: "Figure", kind: str, **how: Any) -> bytes:
    """A figure as `png`, `pdf` or `svg`, without a date: the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, metadata=_NO_DATE[kind], **how)
    return buffer.getvalue()
