"""Common parts of the pages that clrender writes: style, tables and plots."""

__all__: list[str] = []
