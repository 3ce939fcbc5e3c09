"""What pages that clrender writes have in common: style, tables and plots."""

__all__: list[str] = []
