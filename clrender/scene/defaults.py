"""The tables `image` and `render` of a scene file: default settings, which a render may override."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AliasChoices, Field, create_model, model_validator

from clrender.integrators import INTEGRATORS
from clrender.scene.values import Part, SettingValue, fault
from clrender.settings import PIXEL_LIMIT, SETTINGS, Setting, not_taken
from clrender.wording import counted, grouped

__all__ = ["Image", "Render"]


def _keys(section: str) -> dict[str, Any]:
    """Fields of a scene file's table, built from the settings table."""
    of_it = [setting for setting in SETTINGS.values() if setting.section == section]
    return {setting.name: (Annotated[Any, SettingValue(setting)], _field(setting)) for setting in of_it}


def _field(setting: Setting) -> Any:
    """The default of a key, with the former name if there is one."""
    if not setting.former:
        return setting.default
    return Field(setting.default, validation_alias=AliasChoices(setting.name, setting.former))


class _Size(Part):
    @model_validator(mode="after")
    def _fits(self) -> _Size:
        assert isinstance(self, Image)
        if self.width * self.height > PIXEL_LIMIT:
            size = f"{self.width} x {self.height} is {counted(self.width * self.height, 'pixel')}"
            raise fault("image", f"is too large: {size}, but {grouped(PIXEL_LIMIT)} is the most")
        return self


class _Defaults(Part):
    @model_validator(mode="after")
    def _go_together(self) -> _Defaults:
        values = self.model_dump()
        for name, allowed in INTEGRATORS[values["integrator"]].takes.items():
            if values[name] not in allowed:
                raise fault("setting", not_taken(name, values[name], values["integrator"]), name)
        return self


if TYPE_CHECKING:

    class Image(_Size):
        """Size of the image."""

        width: int = 800
        height: int = 800

    class Render(_Defaults):
        """Defaults of a render's settings; the command line wins."""

        def __getattr__(self, name: str) -> Any: ...

else:
    Image = create_model("Image", __base__=_Size, __doc__="Size of the image.", **_keys("image"))
    Render = create_model(
        "Render",
        __base__=_Defaults,
        __doc__="Defaults of a render's settings; the command line wins.",
        **_keys("render"),
    )
