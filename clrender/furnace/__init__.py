"""The physics of materials, measured with the kernels that render: energy, reciprocity, sampling."""

__all__: list[str] = []
