"""
Print the help of commands: options in groups, the common ones alone with ``--help``.

``--help-all`` prints all. A command with few options prints all in any case.
"""

from __future__ import annotations

import difflib
import inspect
import re
from typing import Any

import click


def _map_synonyms(meant: dict[str, str]) -> dict[str, str]:
    """Return the option for each synonym, from the synonyms of each option."""
    return {word: name for name, words in meant.items() for word in words.split()}


OPTION_SYNONYMS = _map_synonyms({
    "--background transparent": "--transparent --alpha",
    "--background COLOR": "--bg --background-color",
    "--size WxH": "--width --height -w -W -H --resolution --res --image-size",
    "--output OUT": "--out --save",
    "the FILE alone": "--input -i --file",
    "--position X,Y,Z": "--eye --camera-position",
    "--target X,Y,Z": "--look-at --lookat --center",
    "--azimuth DEG": "--yaw --heading --rotate --angle",
    "--elevation DEG": "--pitch",
    "--fov DEG": "--field-of-view --fovy --fov-y --yfov",
    "--projection orthographic": "--ortho --orthographic",
    "--projection perspective": "--perspective",
    "--up z": "--z-up",
    "--up y": "--y-up",
    "--pose FILE": "--extrinsics --camera-pose",
    "--camera FILE": "--calibration --colmap --transforms",
    "--intrinsics FX,FY,CX,CY": "--camera-matrix --k -K",
    "--mask FILE": "--silhouette",
    "--mask FILE --mask-of object_id": "--segmentation",
    "--color COLOR": "--base-color --mesh-color --colour",
    "--scalars NAME": "--field --scalar --color-by",
    "--colormap NAME": "--cmap --color-map",
    "--range LOW,HIGH": "--clim --vmin --vmax",
    "--norm log": "--log --log-scale",
    "--contours N": "--isolines --iso-lines",
    "--colorbar": "--scalar-bar --legend",
    "--light X,Y,Z": "--lights --lighting",
    "--light sun": "--sun",
    "--samples 16": "--antialias --antialiasing --anti-aliasing --aa --msaa --spp",
    "--samples 64": "--ssaa --supersampling",
    "--ambient-occlusion": "--ao --ssao",
    "--eye-dome 1": "--edl",
    "--environment FILE": "--env --envmap --hdri --ibl --skybox",
    "--tone-map CURVE": "--tonemap --tonemapping",
    "--exposure STOPS": "--gamma --brightness",
    "--wireframe overlay": "--edges --wire",
    "--hidden-lines": "--hidden --dashed",
    "--shading phong": "--smooth",
    "--shading flat": "--flat",
    "--shading unlit": "--unlit",
    "--cull back": "--backface-culling --backface-cull",
    "--outputs normal": "--normals --normal",
    "--outputs object_id": "--ids --labels",
    "--depth FILE": "--depth-map",
    "--outputs NAMES": "--aov --buffers --passes",
    "--threads N": "--jobs --cores --cpus -j",
    "--quiet": "--silent",
    "--debug": "--verbose --traceback",
    "--quality draft": "--draft --fast",
    "--quality reference": "--best",
    "--fps N": "--frame-rate --framerate",
    "--views N": "--count",
})  # fmt: skip
"""Options by the names that other programs give them."""

CHOICE_SYNONYMS = _map_synonyms({
    "orthographic": "ortho parallel",
    "perspective": "persp",
    "phong": "smooth blinn blinn-phong",
    "gouraud": "lambert",
    "unlit": "unshaded constant",
    "pbr": "metallic",
    "back": "backface",
    "reference": "best",
    "draft": "low fast",
    "color": "colour rgb rgba image",
    "normal": "normals",
    "position": "points xyz",
    "uv": "texcoord",
    "motion": "flow",
    "face_id": "triangle_id",
    "object_id": "instance instances segmentation labels ids",
    "coverage": "mask alpha silhouette",
})  # fmt: skip
"""Choices by other names for them."""

COMMAND_SYNONYMS = _map_synonyms({
    "render": "draw image picture thumbnail thumbnails",
    "view": "show display open",
    "turntable": "spin animate rotate",
    "info": "inspect stat stats",
    "explain": "plan",
    "accuracy": "benchmark",
    "warmup": "compile",
    "doctor": "check",
    "--help": "help",
    "--version": "version",
})  # fmt: skip
"""Commands by other names for them."""

_INVALID_CHOICE_PREFIX = re.compile(r"'([^']*)' is not (?:one of )?'")
"""Start of click's message about an invalid choice."""

_UNKNOWN_COMMAND_PREFIX = re.compile(r"No such command '([^']*)'")


def add_advice(error: click.ClickException) -> str:
    """Return an error's message, with a "did you mean" if a name is similar."""
    message = error.format_message()
    if isinstance(error, click.NoSuchOption):
        return f"No such option {error.option_name}" + _find_similar_option(error)
    command = _UNKNOWN_COMMAND_PREFIX.search(message)
    if command is not None and isinstance(error, click.UsageError) and error.ctx is not None:
        known = list(getattr(error.ctx.command, "commands", ()))
        return f"No such command or file {command[1]!r}" + suggest_words(
            command[1], known, COMMAND_SYNONYMS
        )
    parameter = getattr(error, "param", None)
    if parameter is not None and isinstance(parameter.type, click.Choice):
        value = _INVALID_CHOICE_PREFIX.search(message)
        if value is not None:
            meant = suggest_words(value[1], list(parameter.type.choices), CHOICE_SYNONYMS)
            return message.removesuffix(".") + meant
    return message


def suggest_words(word: str, known: list[str], meant: dict[str, str]) -> str:
    """Return " Did you mean ...?" with the known words that are similar; "" if none is."""
    lower = word.lower().strip()
    other = meant.get(lower)
    if other is not None and (other in known or other.startswith("-")):
        return f"; did you mean {other}?"
    names = _find_nearest(lower, known)
    return f"; did you mean {' or '.join(names)}?" if names else ""


def _find_nearest(word: str, known: list[str]) -> list[str]:
    """Return the closest known word; two if the second is about as close."""
    names = difflib.get_close_matches(word, known, n=2)
    nearness = [difflib.SequenceMatcher(None, word, name).ratio() for name in names]
    return [name for name, near in zip(names, nearness, strict=True) if near > nearness[0] - 0.2]


def _find_similar_option(error: click.NoSuchOption) -> str:
    """Return the option that an unknown one probably means; "" if none is similar."""
    name, context = error.option_name, error.ctx
    if context is None:
        return ""
    own = _list_options(context.command)
    other = OPTION_SYNONYMS.get(name) or OPTION_SYNONYMS.get(name.lower())
    if other is not None and (not other.startswith("-") or other.split()[0] in own):
        return f"; did you mean {other}?"
    program = context.find_root().command
    commands = getattr(program, "commands", {})
    having = [known for known, command in commands.items() if name in _list_options(command)]
    if having and context.command is program:
        return " before the command or FILE: options stand behind it"
    if having:
        *others, last = having
        names = f"{', '.join(others)} and {last}" if others else last
        return f"; {names} {'have' if others else 'has'} it"
    near = _find_nearest(name, [one for one in own if one.startswith("--")])
    return f"; did you mean {' or '.join(near)}?" if near else ""


def _list_options(command: click.Command) -> list[str]:
    """Return the spellings of a command's options, without hidden ones."""
    shown = [one for one in command.params if not getattr(one, "hidden", False)]
    return [name for one in shown for name in (*one.opts, *one.secondary_opts)]


OPTION_GROUPS = {
    "Camera": (
        "views", "layout", "seed", "azimuth", "elevation", "zoom", "fov", "fov_y", "projection",
        "up", "position", "target", "pose", "convention", "intrinsics", "camera_file",
        "lens", "time",
        "animation", "animate", "turns",
    ),
    "Look": (
        "style", "background", "color", "light", "shading", "wireframe", "wireframe_color", "cull",
        "scalars", "colormap", "scalar_range", "norm", "contours", "colorbar", "variant",
    ),
    "Effects": (
        "shadows", "environment", "ambient_occlusion", "eye_dome", "outline", "outline_width",
        "hidden_lines", "tone_map", "exposure", "vignette", "section", "section_lines",
    ),
    "Outputs": (
        "output", "force", "size", "outputs", "depth_file", "scale", "mask_file", "mask_of",
        "frames", "fps", "as_json", "pixel", "diagnose", "measure",
    ),
    "Accuracy": (
        "preset", "samples", "changes", "time_budget", "knobs", "budget", "max_error",
    ),
    "Files": ("on_invalid", "on_damage", "resource_root", "max_bytes", "isolate"),
}  # fmt: skip
"""Titles of groups, and the Python names of their options; the rest are miscellaneous."""

OTHER_GROUP = "Misc"

COMMON_OPTIONS = (
    "output", "force", "size", "outputs", "depth_file", "mask_file", "frames", "fps",
    "views", "layout", "azimuth", "elevation", "zoom", "up", "style", "background", "color",
    "light", "wireframe", "shadows", "environment", "ambient_occlusion", "outline", "tone_map",
    "section", "samples", "preset", "backend", "pixel", "measure", "knobs", "budget", "max_error",
    "workers", "stats", "quiet",
)  # fmt: skip
"""What ``--help`` shows of a command with many options."""

MAX_SHORT_OPTIONS = 16
"""Most options that ``--help`` shows at once: more do not fit on a screen."""


class Command(click.Command):
    """A command whose help has groups."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.params.append(
            click.Option(
                ["--help-all"], is_flag=True, is_eager=True, expose_value=False,
                hidden=len(self.params) <= MAX_SHORT_OPTIONS, callback=_show_all,
                help="Show all options and exit.",
            )
        )  # fmt: skip

    def format_help_text(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what the command does; in short its first paragraph."""
        text = inspect.cleandoc(self.help or "")
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(text.split("\n\n")[0] if is_short(context) else text)

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, group by group."""
        listed = [one for one in self.get_params(context) if isinstance(one, click.Option)]
        records = [(one, one.get_help_record(context)) for one in listed]
        options = [(one, record) for one, record in records if record is not None]
        if is_short(context):
            shown = [(one, shorten_record(record)) for one, record in options if is_common(one)]
        else:
            shown = options
        for title in (*OPTION_GROUPS, OTHER_GROUP):
            rows = [record for one, record in shown if find_group(one) == title]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)
        if len(shown) < len(options):
            formatter.write_paragraph()
            formatter.write_text(
                f"{context.command_path} --help-all says more, and shows "
                f"{len(options) - len(shown)} more options."
            )


def is_short(context: click.Context) -> bool:
    """Tell whether the help of a command shows only the common options."""
    options = (one for one in context.command.params if isinstance(one, click.Option))
    has_more = any(one.name == "help_all" and not one.hidden for one in options)
    return has_more and not context.meta.get(SHOWS_ALL, False)


def is_common(option: click.Parameter) -> bool:
    """Tell whether the short help of a command shows an option."""
    return option.name in COMMON_OPTIONS or "--help" in option.opts


def shorten_record(record: tuple[str, str]) -> tuple[str, str]:
    """Return the names of an option, and the first clause of its help."""
    names, text = record
    text, mark, default = text.partition("  [")
    depth = 0
    for place, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and (letter in ";:" or text[place : place + 2] == ". "):
            text = text[:place]
            break
    return names, f"{text.rstrip('.')}.{mark}{default}"


def find_group(option: click.Parameter) -> str:
    """Return the title of the group that an option belongs to."""
    return next(
        (title for title, names in OPTION_GROUPS.items() if option.name in names), OTHER_GROUP
    )


SHOWS_ALL = "rasterjit.help_all"
"""Key in click's context: whether the help shows all options."""


def _show_all(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Print the help with all options, and end."""
    if value and not context.resilient_parsing:
        context.meta[SHOWS_ALL] = True
        click.echo(context.get_help(), color=context.color)
        context.exit()
