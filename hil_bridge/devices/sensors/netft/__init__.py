"""ATI Net F/T boxes: wire, page, settings."""
