"""Picture files drawn with matplotlib, which the extra `figures` installs."""

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
    """Import and return matplotlib, which takes almost a second. Raises ConfigError if it is missing."""
    try:
        import matplotlib
    except ImportError:
        raise ConfigError(
            f"picture files need matplotlib, which is not installed: {install_command('figures')}, or omit them"
        ) from None
    return matplotlib


def save_figure(figure: "Figure", kind: str, **how: Any) -> bytes:
    """Render a figure as `png`, `pdf` or `svg` without a date, so that equal figures give equal bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, metadata=_NO_DATE[kind], **how)
    return buffer.getvalue()
