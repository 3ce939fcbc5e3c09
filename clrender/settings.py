"""THE table of settings. The command line, scene files and their schema, calls and request hashes derive from it.

A new setting is one field of `RenderSettings`, plus the code in its integrator that uses it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

from clrender.errors import UsageError
from clrender.integrators import INTEGRATORS
from clrender.limits import Bands, Bytes, Choice, Domain, Flag, NotAllowed, Range, Region, given_too, nearest, shown
from clrender.process.memory import check_image, film_bytes
from clrender.wording import counted, grouped

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = [
    "FIRST_LOOK",
    "IMAGE",
    "PIXEL_LIMIT",
    "REPLICATE_SPP",
    "SETTINGS",
    "SPP_LIMIT",
    "STOP",
    "WORK",
    "RenderSettings",
    "Setting",
    "check_memory",
    "not_taken",
    "present",
    "settings_for",
    "settings_of",
]

IMAGE: Final = "image"
"""Group of settings that determine the image: the request."""
WORK: Final = "work"
"""Group of settings that divide the work into launches; none changes a bit of the image."""
STOP: Final = "stop"
"""Group of settings that decide when the render stops."""

PIXEL_LIMIT: Final = 2**30
FILTER_RADII: Final = (0.0625, 8.0)
"""Smallest and largest radius of a pixel filter, pixels."""

REPLICATE_SPP: Final = 16
"""Default samples per replicate if errors are requested but no replicates."""
FIRST_LOOK: Final = 16
"""Replicates per pixel that are needed before their variance is a usable stopping criterion."""
SPP_LIMIT: Final = 2**20
"""Most samples per pixel."""
ERROR_SPP: Final = 16384
"""Default maximum of samples per pixel if a render stops by its error."""


@dataclass(frozen=True)
class Setting:
    """A line of the table.

    Attributes
    ----------
    name : str
        Field of `RenderSettings`, key of the scene file, argument of `clrender.render`.
    domain : Domain
        The allowed values.
    default
        The value if none is given; None is allowed only if it is the default.
    help : str
        Description with units, for ``--help`` and the schema.
    unset : str
        Meaning of the default, if the value itself does not show it.
    group : str
        `IMAGE`, `WORK` or `STOP`.
    section : str or None
        Table of the scene file that may hold it.
    integrator : str or None
        The only integrator that uses it; None: all.
    option : str or None
        Option of ``clrender render``.
    metavar : str
        Placeholder of the option's value in the help.
    former : str
        Its name in earlier versions: still accepted wherever the name is, and kept in requests; empty if it had none.
    late : bool
        Whether it was added when there were films already: requests leave its default out.
    """

    name: str
    domain: Domain
    default: Any
    help: str
    unset: str
    group: str
    section: str | None
    integrator: str | None
    option: str | None
    metavar: str
    former: str
    late: bool

    def accept(self, value: object) -> Any:
        """The value, checked and converted to a built-in Python type.

        Raises
        ------
        NotAllowed
            When the value is outside the domain.
        """
        return None if value is None and self.default is None else self.domain.accept(value)

    @property
    def former_values(self) -> Mapping[str, str]:
        """Spellings of values in earlier versions, and the present ones."""
        return self.domain.former if isinstance(self.domain, Choice) else {}

    def recorded(self, value: Any) -> Any:
        """The value as requests have it: in the former spelling, if there is one, and lists as in JSON."""
        plain = list(value) if isinstance(value, tuple) else value
        return next((old for old, new in self.former_values.items() if new == value), plain)

    @property
    def default_words(self) -> str:
        """Text for the default in the help."""
        return self.unset or str(self.default)

    def schema(self) -> dict[str, Any]:
        """JSON Schema of the setting."""
        schema = self.domain.schema()
        if self.default is None:
            schema = {"anyOf": [schema, {"type": "null"}]}
        return {**schema, "description": f"{self.help} (default: {self.default_words})"}


def _setting(
    default: Any,
    domain: Domain,
    help: str,
    unset: str = "",
    group: str = IMAGE,
    section: str | None = "render",
    integrator: str | None = None,
    option: str | None = "",
    metavar: str = "",
    former: str = "",
    late: bool = False,
) -> Any:
    """A field of `RenderSettings`. `option` defaults to the field's name; None means no option."""
    about = {"domain": domain, "help": help, "unset": unset, "group": group, "section": section}
    about |= {"integrator": integrator, "option": option, "metavar": metavar or domain.metavar, "former": former}
    about["late"] = late
    return dataclasses.field(default=default, metadata=about)


def _work(domain: Domain, help: str, default: Any = None, **more: Any) -> Any:
    unset = more.pop("unset", "chosen per device" if default is None else "")
    return _setting(default, domain, f"{help}; does not change the image", unset, WORK, None, **more)


_SIDE: Final = Range(1, 65536, whole=True)
_BLOCK: Final = 4
"""Side of a block of pixels, pixels."""


@dataclass(frozen=True)
class RenderSettings:
    """Settings of a render; `SETTINGS` gives the meaning and the allowed values of each field.

    NumPy scalars are converted to Python numbers.

    Raises
    ------
    UsageError
        When a value, or a combination of values, is not allowed.
    """

    spp: int = _setting(64, Range(1, SPP_LIMIT, whole=True), "Samples per pixel", group=STOP)
    width: int = _setting(800, _SIDE, "Image width, pixels", section="image", option=None)
    height: int = _setting(800, _SIDE, "Image height, pixels", section="image", option=None)
    crop: tuple[int, int, int, int] | None = _setting(
        None,
        Region(65536),
        "Part of the image to render: left and upper edge, width and height, pixels; its pixels have the bits of the "
        "whole image's",
        "the whole image",
        section=None,
        late=True,
    )
    seed: int = _setting(0, Range(0, 2**32 - 1, whole=True), "Seed of the random numbers")
    integrator: str = _setting("path", Choice(tuple(INTEGRATORS)), "Light transport algorithm")
    filter: str = _setting(
        "box",
        Choice(("box", "tent", "gaussian", "blackman-harris", "mitchell")),
        "Pixel reconstruction filter; samples are distributed according to it",
    )
    filter_radius: float | None = _setting(
        None,
        Range(*FILTER_RADII),
        "Radius of the pixel filter, pixels; its function is stretched to it",
        "that of the filter",
        metavar="R",
        late=True,
    )
    shadow_rays: int = _setting(1, Range(1, 4096, whole=True), "Shadow rays per diffuse hit", metavar="M")
    indirect_rays: int = _setting(
        1, Range(0, 4096, whole=True), "Continuation rays from the first diffuse hit; 0: direct light only"
    )
    max_depth: int | None = _setting(
        None,
        Range(0, 2**31 - 1, whole=True),
        "Maximum number of scattering events; 0: directly visible emission only",
        "no limit",
    )
    roulette: str = _setting(
        "throughput",
        Choice(("throughput", "constant", "none"), {"absorption": "constant"}),
        "Russian roulette: by path throughput, by a constant probability per material, or none",
    )
    termination: float | None = _setting(
        None,
        Range(0.0, 1.0, below=True),
        "For --roulette constant: probability that a path ends at a hit",
        "set by each material",
        metavar="P",
        former="absorption",
    )
    sampling: str = _setting(
        "mis",
        Choice(("mis", "light", "bsdf")),
        "Direct light sampling: light and BSDF sampling combined by multiple importance sampling, or one of them",
    )
    light_sampler: str = _setting(
        "auto",
        Choice(("auto", "bvh", "power", "uniform")),
        "How a light is selected at each shading point: by a light BVH, by power or uniformly",
        "auto: bvh for 5 or more lights",
    )
    reuse: int = _setting(
        16,
        Choice((1, 2, 4, 8, 16)),
        "For integrator reuse: number of pixels that share indirect light",
        integrator="reuse",
    )
    photons: int = _setting(
        131072, Range(1, 2**26, whole=True), "For integrator photon: photons per sample", integrator="photon"
    )
    photon_radius: float | None = _setting(
        None,
        # Geometric optics holds only at lengths above the wavelength of light.
        Range(1e-6, 1e12),
        "For integrator photon: initial radius of the density estimate, metres",
        "1/100 of the scene radius",
        integrator="photon",
        metavar="R",
    )
    light_paths: int | None = _setting(
        None,
        Range(1, 2**28, whole=True),
        "For integrator bdpt: paths from the lights for each sample of the image",
        "as many as pixels",
        integrator="bdpt",
        metavar="N",
    )
    guiding: str = _setting(
        "off",
        Choice(("off", "on", "auto")),
        "For integrator path: guide paths by where training found light; auto: where that pays",
        integrator="path",
        late=True,
    )
    guiding_paths: int = _setting(
        2**19,
        Range(2**6, 2**24, whole=True),
        "For guiding: number of paths that it is trained with",
        integrator="path",
        metavar="N",
        late=True,
    )
    guiding_memory: int = _setting(
        64 << 20,
        Bytes(1 << 16),
        "For guiding: limit of its memory on each device, bytes; the option also accepts the suffixes K, M and G",
        integrator="path",
        metavar="BYTES",
        late=True,
    )
    specular_chains: str = _setting(
        "off",
        Choice(("off", "on")),
        "For integrators path and bdpt: sample light over chains of one or two mirrors or smooth glass boundaries, "
        "also that of lights without extent",
        late=True,
    )
    spectral: bool = _setting(
        False,
        Flag(),
        "Render wavelengths in the place of red, green and blue",
        "off",
        late=True,
    )
    bands: tuple[int, int] | None = _setting(
        None,
        Bands(),
        "With spectral: three bands of the spectrum in place of red, green and blue: the first, and the number of all",
        "red, green and blue",
        section=None,
        option=None,
        late=True,
    )
    patches: int = _setting(
        8000,
        Range(1, 2**20, whole=True),
        "For integrator radiosity: approximate number of patches",
        integrator="radiosity",
    )
    patch_rays: int = _setting(
        256, Range(1, 2**16, whole=True), "For integrator radiosity: rays per patch", integrator="radiosity"
    )
    radiosity_display: str = _setting(
        "smooth",
        Choice(("constant", "smooth", "gather")),
        "For integrator radiosity: constant radiance per patch, smooth interpolation, or final gather",
        integrator="radiosity",
    )
    replicate_spp: int | None = _setting(
        None,
        Choice(tuple(2**k for k in range(13))),
        "Samples per replicate; replicates have independent random numbers, from which standard errors are estimated",
        f"no replicates; {REPLICATE_SPP} with --error or --aov stderr",
        section=None,
        metavar="N",
    )
    tile: int = _work(_SIDE, "Side length of a tile, pixels", 64)
    samples_per_pass: int | None = _work(
        Range(1, 2**20, whole=True), "Samples per pixel and kernel launch", metavar="K"
    )
    work_group: int | None = _work(Range(1, 4096, whole=True), "Work-items per work-group")
    lanes: int | None = _work(Choice((1, 4, 8, 16)), "Paths per work-item")
    max_memory: int | None = _work(
        Bytes(1 << 24),
        "Memory limit of the host and of each device, bytes; the option also accepts the suffixes K, M and G",
        unset="no limit",
        metavar="BYTES",
    )
    traversal: str | None = _work(
        Choice(("packet", "single")), "BVH traversal on CPUs: ray packets or single rays", option=None
    )
    kernels: str | None = _work(
        Choice(("whole", "staged")),
        "Kernels of integrators path and direct: one for whole paths, or one for each stage of them, with one path per "
        "work-item",
        unset="whole",
    )
    code: str | None = _work(
        Choice(("fast", "small", "any")),
        "Machine code: fast, small (on CPUs), which is compiled in about half the time, or fast code for any scene",
        unset="chosen by the number of samples and what is compiled already",
    )
    time_limit: float | None = _setting(
        None,
        Range(0.0, above=True, unit="seconds"),
        "Stop after this many seconds and write the image so far",
        "no limit",
        STOP,
        None,
        option="time",
        metavar="S",
    )
    error: float | None = _setting(
        None,
        Range(0.0, 1.0, above=True, below=True),
        "Stop when most pixels are within this relative error of luminance; --spp is then the maximum",
        "no limit",
        STOP,
        None,
        metavar="E",
    )
    confidence: float = _setting(
        0.95, Range(0.0, 1.0, above=True, below=True), "For --error: confidence level", "", STOP, None, metavar="C"
    )
    share: float = _setting(
        0.95, Range(0.0, 1.0, above=True), "For --error: fraction of the pixels that must be within it", "", STOP, None
    )
    error_floor: float | None = _setting(
        None,
        Range(0.0, above=True),
        "For --error: luminance, W/(sr m2), below which the error is relative to this value",
        "1/10 of the image mean",
        STOP,
        None,
        metavar="L",
    )

    def __post_init__(self) -> None:
        for name, setting in SETTINGS.items():
            try:
                value = setting.accept(getattr(self, name))
            except NotAllowed as error:
                raise UsageError(f"{name} {error}") from None
            object.__setattr__(self, name, value)
        if (pixels := self.width * self.height) > PIXEL_LIMIT:
            raise UsageError(
                f"an image of {self.width} x {self.height} has {counted(pixels, 'pixel')}; at most "
                f"{grouped(PIXEL_LIMIT)} fit"
            )
        if self.crop is not None:
            self._check_crop(*self.crop)
        if self.kernels == "staged" and (self.lanes or 1) > 1:
            raise UsageError(f"lanes is {self.lanes}, but staged kernels take one path per work-item; leave it out")
        for name, allowed in INTEGRATORS[self.integrator].takes.items():
            if getattr(self, name) not in allowed:
                raise UsageError(f"{name} {not_taken(name, getattr(self, name), self.integrator)}")
        if self.error is not None and self.replicate_spp is None:
            object.__setattr__(self, "replicate_spp", REPLICATE_SPP)
        if self.replicate_spp is not None:
            self._check_replicates(self.replicate_spp)

    def _check_crop(self, x: int, y: int, width: int, height: int) -> None:
        crop = f"crop is {Region.text((x, y, width, height))}"
        if x + width > self.width or y + height > self.height:
            raise UsageError(f"{crop}, which is not within the image of {self.width} x {self.height}")
        ends = ((x, 0), (y, 0), (x + width, self.width), (y + height, self.height))
        if INTEGRATORS[self.integrator].shares == "block" and any(n % _BLOCK and n != end for n, end in ends):
            raise UsageError(
                f"{crop}, but pixels of the integrator {self.integrator} share light in blocks of {_BLOCK} x {_BLOCK}: "
                f"its edges must be multiples of {_BLOCK}, or those of the image"
            )
        if self.crop == (0, 0, self.width, self.height):
            object.__setattr__(self, "crop", None)

    @property
    def film_size(self) -> tuple[int, int]:
        """Width and height of what is rendered, pixels: of the crop, or of the whole image."""
        return (self.width, self.height) if self.crop is None else self.crop[2:]

    def _check_replicates(self, size: int) -> None:
        if not INTEGRATORS[self.integrator].has_errors:
            words = INTEGRATORS[self.integrator].bias
            raise UsageError(
                f"the integrator {self.integrator} is {words}: its error cannot be estimated from the spread of its "
                "samples, so it supports neither replicates nor standard errors; leave them out, or choose an unbiased "
                "integrator"
            )
        if self.error is not None and self.spp < FIRST_LOOK * size:
            raise UsageError(
                f"spp is {self.spp}, but with error it is the maximum number of samples per pixel, and the first test "
                f"needs {counted(FIRST_LOOK, 'replicate')} of {size}; set it to {FIRST_LOOK * size} or more, or "
                "leave it out"
            )
        if self.spp % size:
            above = (self.spp // size + 1) * size
            cure = f"{above - size} or {above}" if above > size else f"{size}"
            raise UsageError(f"spp is {self.spp}, but must be a multiple of replicate_spp, {size}: for example {cure}")

    def request(self) -> dict[str, Any]:
        """The settings that determine the image, as JSON values; not the number of samples: a film may hold fewer.

        What was renamed has its former name, so that films of earlier versions are of the same request.
        """
        return {
            setting.former or name: setting.recorded(getattr(self, name))
            for name, setting in SETTINGS.items()
            if setting.group == IMAGE and setting.integrator in (None, self.integrator)
            if not (setting.late and getattr(self, name) == setting.default)
        }

    def _crop_values(self) -> dict[str, int]:
        if self.crop is None:
            return {}
        x, y, width, height = self.crop
        return {"left": x, "top": y, "less_width": self.width - width, "less_height": self.height - height}

    @property
    def _has_chains(self) -> bool:
        return INTEGRATORS[self.integrator].specular_chains

    def struct(self, tile: int, fixed: Mapping[str, Any] | None = None) -> npt.NDArray[np.void]:
        """The `Settings` struct that the kernels read.

        Parameters
        ----------
        tile : int
            Side of a tile, pixels.
        fixed : mapping, optional
            Fields whose values override the user's: `clrender.integrators.Integrator.fixed`.

        Returns
        -------
        (1,) `Settings`
        """
        # Imported here because `--help` should not wait for NumPy to load.
        import numpy as np

        from clrender import layout

        settings = np.zeros(1, layout.dtype("Settings"))
        indirect = (fixed or {}).get("indirect_rays", self.indirect_rays)
        values: dict[str, int] = {
            "width": self.width,
            "height": self.height,
            "tile": tile,
            "seed": self.seed,
            "shadow_rays": self.shadow_rays,
            "indirect_rays": indirect,
            "max_depth": layout.NONE if self.max_depth is None else self.max_depth,
            "roulette": getattr(layout, f"ROULETTE_{self.roulette.upper()}"),
            # Without indirect rays, only light samples find the lights from diffuse surfaces.
            "light_samples": 0 if self.sampling == "bsdf" and indirect else self.shadow_rays,
            "bsdf_samples": 0 if self.sampling == "light" else indirect,
            "reuse": self.reuse,
            "replicate_spp": self.replicate_spp or 0,
            "light_paths": self.light_paths or self.width * self.height,
            "spectral": 2 if self.spectral and self.bands else int(self.spectral),
            "bands": 1024 * self.bands[0] + self.bands[1] if self.bands else 0,
            "specular_chains": int(self.specular_chains == "on" and self._has_chains and indirect == 1),
            **self._crop_values(),
            **(fixed or {}),
        }
        if self.filter != "box" or self.filter_radius not in (None, 0.5):  # which random numbers are in any case
            from clrender.image.pixel_filter import filter_table

            table = filter_table(self.filter, self.filter_radius)
            settings["filter_lines"] = table.lines.ravel()
            settings["filter_negative"], settings["filter_weight"] = table.negative, table.weight
            settings["filter_radius"] = table.radius
        for name, value in values.items():
            settings[name] = value
        return settings


def _line(field: dataclasses.Field[Any]) -> Setting:
    about = dict(field.metadata)
    if about["option"] is not None:
        about["option"] = "--" + (about["option"] or field.name).replace("_", "-")
    return Setting(field.name, default=field.default, **about)


SETTINGS: Final[Mapping[str, Setting]] = {field.name: _line(field) for field in dataclasses.fields(RenderSettings)}
"""All settings by name, in the order of the help."""
_FORMER: Final[Mapping[str, str]] = {setting.former: name for name, setting in SETTINGS.items() if setting.former}


def present(given: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by their present names and spellings; some may be given by those of earlier versions.

    Parameters
    ----------
    given : mapping
        Other names and values are not changed.

    Raises
    ------
    UsageError
        When a setting is given by both of its names.
    """
    for former, name in _FORMER.items():
        if former in given and name in given:
            raise UsageError(f"{former} {given_too(name)}")
    values = {_FORMER.get(name, name): value for name, value in given.items()}
    for name in values.keys() & SETTINGS.keys():
        if isinstance(values[name], str):
            values[name] = SETTINGS[name].former_values.get(values[name], values[name])
    return values


def not_taken(name: str, value: object, integrator: str) -> str:
    """The error text for a value that an integrator does not accept; it follows the setting's name."""
    words = Choice(tuple(INTEGRATORS[integrator].takes[name])).words  # type: ignore[arg-type]
    return f"is {shown(value)}, but the integrator {integrator} takes {words} only"


def settings_of(integrator: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """The given settings without those of other integrators."""
    return {
        name: value
        for name, value in given.items()
        if name not in SETTINGS or SETTINGS[name].integrator in (None, integrator)
    }


class _Table(Protocol):
    def model_dump(self) -> dict[str, Any]: ...


class _Scene(Protocol):
    """The attributes of `clrender.Scene` that are used here; that class depends on this module."""

    @property
    def render(self) -> _Table: ...
    @property
    def image(self) -> _Table: ...


def settings_for(
    scene: _Scene, size: tuple[int, int] | None, given: Mapping[str, Any], beside: Sequence[str] = ("size",)
) -> RenderSettings:
    """Combine the settings of a render: the given ones, else the scene's, else the defaults.

    Every given setting must have an effect. The scene's settings may be for another integrator than the requested one.

    Parameters
    ----------
    scene : Scene
    size : (int, int) or None
        Width and height, pixels.
    given : mapping
        Fields of `RenderSettings`, or their former names.
    beside : sequence of str
        What else the caller takes: an unknown name may stand for one of these.

    Raises
    ------
    UsageError
        When a name is unknown, a value is not allowed or has no effect, or the image does not fit into memory.
    """
    written = {_FORMER.get(name, name): name for name in given}
    given = present(given)
    for name in given:
        if name not in SETTINGS:
            known = (*beside, *SETTINGS)
            near = nearest(name, known) or f"; there are {', '.join(known)}"
            raise UsageError(f"there is no setting {shown(name)}{near}")
    values = {**scene.render.model_dump(), **scene.image.model_dump(), **_sides(size), **given}
    if given.get("error") is not None and given.get("spp") is None:
        values["spp"] = ERROR_SPP
    integrator = values["integrator"]
    if isinstance(integrator, str) and integrator in INTEGRATORS:
        for name, allowed in INTEGRATORS[integrator].takes.items():
            if name not in given and values[name] not in allowed:
                values[name] = allowed[0]
    wanted = RenderSettings(**values)
    _refuse_unused(wanted, written)
    check_memory(wanted)
    return wanted


def _sides(size: Any) -> dict[str, Any]:
    if size is None:
        return {}
    try:
        width, height = size
    except (TypeError, ValueError):
        raise UsageError(f"size is {shown(size)}, but must be two whole numbers, width and height") from None
    return {"width": width, "height": height}


def _refuse_unused(wanted: RenderSettings, given: Mapping[str, str]) -> None:
    """Raise an error if a given setting, here with the name that it was given by, would have no effect."""
    for name in given:
        owner = SETTINGS[name].integrator
        if owner not in (None, wanted.integrator) and getattr(wanted, name) is not None:
            raise UsageError(
                f"{given[name]} has no effect with the integrator {wanted.integrator}; it belongs to {owner}"
            )
    if "termination" in given and wanted.termination is not None and wanted.roulette != "constant":
        name = given["termination"]
        raise UsageError(f"{name} has no effect with the roulette {wanted.roulette}; it belongs to constant")
    if "specular_chains" in given and wanted.specular_chains == "on":
        name = given["specular_chains"]
        if not INTEGRATORS[wanted.integrator].specular_chains:
            owners = " and ".join(each for each, about in INTEGRATORS.items() if about.specular_chains)
            text = f"{name} has no effect with the integrator {wanted.integrator}; it belongs to {owners}"
            raise UsageError(text)
        if wanted.indirect_rays != 1:
            raise UsageError(f"{name} works with one indirect ray; leave out indirect_rays {wanted.indirect_rays}")
    if "bands" in given and wanted.bands is not None and not wanted.spectral:
        raise UsageError(f"{given['bands']} has no effect without spectral; set that as well, or leave it out")
    for name in ("guiding_paths", "guiding_memory"):
        if name in given and wanted.guiding == "off":
            raise UsageError(f"{given[name]} has no effect without guiding; set guiding to on or auto as well")
    for name in ("confidence", "share", "error_floor"):
        if name in given and getattr(wanted, name) is not None and wanted.error is None:
            raise UsageError(f"{name} has no effect without error; set the relative error as well, such as error 0.05")


def check_memory(wanted: RenderSettings) -> None:
    """Check that the film fits into the machine's memory, or into the memory limit.

    Raises
    ------
    UsageError
        When it does not fit.
    """
    check_image(*wanted.film_size, wanted.max_memory, film_bytes(wanted.replicate_spp is not None))
