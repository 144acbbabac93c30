"""Say in errors about options, choices and commands that there are not what may have been meant."""

from __future__ import annotations

import difflib
import re

import click

MEANT = {
    "--transparent": "--background transparent",
    "--alpha": "--background transparent",
    "--bg": "--background COLOR",
    "--background-color": "--background COLOR",
    "--width": "--size WxH",
    "--height": "--size WxH",
    "-w": "--size WxH",
    "-W": "--size WxH",
    "-H": "--size WxH",
    "--resolution": "--size WxH",
    "--res": "--size WxH",
    "--image-size": "--size WxH",
    "--out": "--output OUT",
    "--save": "--output OUT",
    "--input": "the FILE alone",
    "-i": "the FILE alone",
    "--file": "the FILE alone",
    "--eye": "--position X,Y,Z",
    "--camera-position": "--position X,Y,Z",
    "--look-at": "--target X,Y,Z",
    "--lookat": "--target X,Y,Z",
    "--center": "--target X,Y,Z",
    "--yaw": "--azimuth DEG",
    "--heading": "--azimuth DEG",
    "--rotate": "--azimuth DEG",
    "--angle": "--azimuth DEG",
    "--pitch": "--elevation DEG",
    "--field-of-view": "--fov DEG",
    "--fovy": "--fov DEG",
    "--fov-y": "--fov DEG",
    "--yfov": "--fov DEG",
    "--ortho": "--projection orthographic",
    "--orthographic": "--projection orthographic",
    "--perspective": "--projection perspective",
    "--z-up": "--up z",
    "--y-up": "--up y",
    "--extrinsics": "--pose FILE",
    "--camera-pose": "--pose FILE",
    "--camera-matrix": "--intrinsics FX,FY,CX,CY",
    "--k": "--intrinsics FX,FY,CX,CY",
    "-K": "--intrinsics FX,FY,CX,CY",
    "--silhouette": "--mask FILE",
    "--segmentation": "--mask FILE --mask-of object_id",
    "--base-color": "--color COLOR",
    "--mesh-color": "--color COLOR",
    "--colour": "--color COLOR",
    "--field": "--scalars NAME",
    "--scalar": "--scalars NAME",
    "--color-by": "--scalars NAME",
    "--cmap": "--colormap NAME",
    "--color-map": "--colormap NAME",
    "--clim": "--range LOW,HIGH",
    "--vmin": "--range LOW,HIGH",
    "--vmax": "--range LOW,HIGH",
    "--isolines": "--contours N",
    "--iso-lines": "--contours N",
    "--scalar-bar": "--colorbar",
    "--legend": "--colorbar",
    "--lights": "--light X,Y,Z",
    "--lighting": "--light X,Y,Z",
    "--sun": "--light sun",
    "--antialias": "--samples 16",
    "--antialiasing": "--samples 16",
    "--anti-aliasing": "--samples 16",
    "--aa": "--samples 16",
    "--msaa": "--samples 16",
    "--ssaa": "--samples 64",
    "--spp": "--samples 16",
    "--supersampling": "--samples 64",
    "--ao": "--ambient-occlusion",
    "--ssao": "--ambient-occlusion",
    "--edl": "--eye-dome 1",
    "--env": "--environment FILE",
    "--envmap": "--environment FILE",
    "--hdri": "--environment FILE",
    "--ibl": "--environment FILE",
    "--skybox": "--environment FILE",
    "--tonemap": "--tone-map CURVE",
    "--tonemapping": "--tone-map CURVE",
    "--gamma": "--exposure STOPS",
    "--brightness": "--exposure STOPS",
    "--edges": "--wireframe overlay",
    "--wire": "--wireframe overlay",
    "--smooth": "--shading phong",
    "--flat": "--shading flat",
    "--unlit": "--shading unlit",
    "--backface-culling": "--cull back",
    "--backface-cull": "--cull back",
    "--normals": "--outputs normal",
    "--normal": "--outputs normal",
    "--ids": "--outputs object_id",
    "--labels": "--outputs object_id",
    "--depth-map": "--depth FILE",
    "--aov": "--outputs NAMES",
    "--buffers": "--outputs NAMES",
    "--passes": "--outputs NAMES",
    "--jobs": "--threads N",
    "--cores": "--threads N",
    "--cpus": "--threads N",
    "-j": "--threads N",
    "--silent": "--quiet",
    "--verbose": "--debug",
    "--traceback": "--debug",
    "--draft": "--quality draft",
    "--fast": "--quality draft",
    "--best": "--quality reference",
    "--frame-rate": "--fps N",
    "--framerate": "--fps N",
    "--count": "--views N",
}
"""What other programs call an option, and what it is here."""

CHOICES_MEANT = {
    "ortho": "orthographic",
    "parallel": "orthographic",
    "persp": "perspective",
    "smooth": "phong",
    "blinn": "phong",
    "blinn-phong": "phong",
    "lambert": "gouraud",
    "unshaded": "unlit",
    "constant": "unlit",
    "metallic": "pbr",
    "backface": "back",
    "best": "reference",
    "low": "draft",
    "fast": "draft",
    "colour": "color",
    "rgb": "color",
    "rgba": "color",
    "image": "color",
    "normals": "normal",
    "points": "position",
    "xyz": "position",
    "texcoord": "uv",
    "flow": "motion",
    "triangle_id": "face_id",
    "instance": "object_id",
    "instances": "object_id",
    "segmentation": "object_id",
    "labels": "object_id",
    "ids": "object_id",
    "mask": "coverage",
    "alpha": "coverage",
    "silhouette": "coverage",
}
"""What else a choice is called."""

COMMANDS_MEANT = {
    "draw": "render",
    "image": "render",
    "picture": "render",
    "thumbnail": "render",
    "thumbnails": "render",
    "show": "view",
    "display": "view",
    "open": "view",
    "spin": "turntable",
    "animate": "turntable",
    "rotate": "turntable",
    "inspect": "info",
    "stat": "info",
    "stats": "info",
    "plan": "explain",
    "benchmark": "accuracy",
    "compile": "warmup",
    "check": "doctor",
    "help": "--help",
    "version": "--version",
}
"""What else a command is called."""

_NO_CHOICE = re.compile(r"'([^']*)' is not (?:one of )?'")
"""How click begins what it says of a choice that there is not."""

_NO_COMMAND = re.compile(r"No such command '([^']*)'")


def with_advice(error: click.ClickException) -> str:
    """Return an error's message, with what may have been meant."""
    message = error.format_message()
    if isinstance(error, click.NoSuchOption):
        return f"No such option {error.option_name}" + _option_meant(error)
    command = _NO_COMMAND.search(message)
    if command is not None and isinstance(error, click.UsageError) and error.ctx is not None:
        known = list(getattr(error.ctx.command, "commands", ()))
        return f"No such command or file {command[1]!r}" + question(
            command[1], known, COMMANDS_MEANT
        )
    parameter = getattr(error, "param", None)
    if parameter is not None and isinstance(parameter.type, click.Choice):
        value = _NO_CHOICE.search(message)
        if value is not None:
            meant = question(value[1], list(parameter.type.choices), CHOICES_MEANT)
            return message.removesuffix(".") + meant
    return message


def question(word: str, known: list[str], meant: dict[str, str]) -> str:
    """Return a question with those of some known words that may be meant; empty: none."""
    lower = word.lower().strip()
    other = meant.get(lower)
    if other is not None and (other in known or other.startswith("-")):
        return f"; did you mean {other}?"
    names = _nearest(lower, known)
    return f"; did you mean {' or '.join(names)}?" if names else ""


def _nearest(word: str, known: list[str]) -> list[str]:
    """Return the one or two known words that a word is like; two if both are about as near."""
    names = difflib.get_close_matches(word, known, n=2)
    nearness = [difflib.SequenceMatcher(None, word, name).ratio() for name in names]
    return [name for name, near in zip(names, nearness, strict=True) if near > nearness[0] - 0.2]


def _option_meant(error: click.NoSuchOption) -> str:
    """Return what may be meant by an option that a command has not; empty: nobody knows."""
    name, context = error.option_name, error.ctx
    if context is None:
        return ""
    own = _options_of(context.command)
    other = MEANT.get(name) or MEANT.get(name.lower())
    if other is not None and (not other.startswith("-") or other.split()[0] in own):
        return f"; did you mean {other}?"
    program = context.find_root().command
    commands = getattr(program, "commands", {})
    having = [known for known, command in commands.items() if name in _options_of(command)]
    if having and context.command is program:
        return " before the command or FILE: options stand behind it"
    if having:
        *others, last = having
        names = f"{', '.join(others)} and {last}" if others else last
        return f"; {names} {'have' if others else 'has'} it"
    near = _nearest(name, [one for one in own if one.startswith("--")])
    return f"; did you mean {' or '.join(near)}?" if near else ""


def _options_of(command: click.Command) -> list[str]:
    """Return how the options of a command are spelled, but for those that are hidden."""
    shown = [one for one in command.params if not getattr(one, "hidden", False)]
    return [name for one in shown for name in (*one.opts, *one.secondary_opts)]
