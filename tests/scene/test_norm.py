"""Norms: values have Matplotlib's colours, and bars Matplotlib's ticks; on any CPU the same."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

import rasterjit as rj
from rasterjit.outputs.ticks import find_log_ticks, find_symlog_ticks, find_ticks
from rasterjit.scene.scalar_field import make_field

CASES = 2000


def own_field(values, colormap="viridis", range=None, norm=None, nan_color=None, contours=None):
    values = np.asarray(values, float)
    return make_field(values, (len(values), 0), colormap, range, norm, nan_color, contours)


def codes(field, values):
    """Return the sRGB codes that a field shows for values, (N, 4), by its linear table."""
    linear = field.table[field.entries(values)]
    rgb = np.floor(255.0 * rj.scene.color.linear_to_srgb(linear[:, :3]) + 0.5)
    return np.column_stack([rgb, np.floor(255.0 * linear[:, 3] + 0.5)]).astype(np.uint8)


def random_norm(colors, rng, low, high):
    """Return a random norm of Matplotlib's over a range, and what is given for it here."""
    kind = rng.choice(
        ["linear", "log", "symlog", "width", "two", "bounds", "center", "power", "clip"]
    )
    inner = np.sort(rng.uniform(low, high, int(rng.integers(1, 9))))
    if kind in ("linear", "log"):
        ends = (low, high) if kind == "linear" else tuple(sorted((abs(low), abs(high))))
        return (colors.Normalize if kind == "linear" else colors.LogNorm)(*ends), kind, ends
    if kind == "symlog":
        return colors.SymLogNorm(2.0, vmin=low, vmax=high), kind, (low, high)
    if kind == "width":
        width = float(10.0 ** rng.uniform(-2, 2))
        return colors.SymLogNorm(width, vmin=low, vmax=high), ("symlog", width), (low, high)
    foreign = {
        "two": lambda: colors.TwoSlopeNorm(inner[0], low, high),
        "bounds": lambda: colors.BoundaryNorm(
            [low, *inner, high], 256, extend=str(rng.choice(["neither", "min", "max", "both"]))
        ),
        "center": lambda: colors.CenteredNorm(inner[0], (high - low) / 2.0),
        "power": lambda: colors.PowerNorm(rng.uniform(0.2, 3.0), low, high),
        "clip": lambda: colors.Normalize(low, high, clip=True),
    }[kind]()
    return foreign, foreign, None


def test_colors_are_those_of_matplotlib_in_2000_random_cases():
    matplotlib, colors = (pytest.importorskip(f"matplotlib{one}") for one in ("", ".colors"))
    rng = np.random.default_rng(7)
    maps = [matplotlib.colormaps[name] for name in ("turbo", "tab10", "coolwarm")]
    ended = maps[0].with_extremes(under="#102030", over="#fedcba", bad="#ff00ff80")
    for _ in range(CASES // 20):
        low = float(rng.normal() * 10.0 ** rng.uniform(-3, 3)) or 1.0
        high = low + float(10.0 ** rng.uniform(-2, 4))
        theirs, given, ends = random_norm(colors, rng, low, high)
        colormap = [*maps, ended][int(rng.integers(4))]
        if getattr(theirs, "boundaries", None) is not None and colormap.N < 256:
            colormap = maps[0]
        # The case's ends themselves, what lies beyond them, and twenty values between.
        step = theirs.vmax - theirs.vmin
        values = rng.uniform(theirs.vmin - step / 4, theirs.vmax + step / 4, 20)
        values = np.concatenate([values, [theirs.vmin, theirs.vmax, np.nan]])
        field = own_field(values, colormap, ends, given)
        wanted = colormap(theirs(np.ma.masked_invalid(values)), bytes=True)
        bad = codes(field, [np.nan])
        wanted = np.where(np.ma.getmaskarray(theirs(np.ma.masked_invalid(values)))[:, None], bad,
                          wanted)  # fmt: skip
        assert np.array_equal(codes(field, values), wanted), (theirs, given)


def test_linear_ticks_are_those_of_matplotlib_in_2000_random_cases():
    ticker = pytest.importorskip("matplotlib.ticker")
    rng = np.random.default_rng(8)
    for _ in range(CASES):
        low = float(rng.normal() * 10.0 ** rng.uniform(-9, 9))
        high = low + abs(low) * float(10.0 ** rng.uniform(-3, 9))
        most = int(rng.integers(3, 12))
        theirs = ticker.MaxNLocator(most, steps=[1, 2, 5, 10]).tick_values(low, high)
        theirs = theirs[(theirs >= low) & (theirs <= high)]
        assert find_ticks(low, high, most) == pytest.approx(theirs.tolist(), rel=1e-9, abs=1e-300)


@pytest.mark.parametrize("kind", ["log", "symlog"])
def test_ticks_of_logarithms_are_those_of_matplotlib_in_2000_random_cases(kind):
    ticker = pytest.importorskip("matplotlib.ticker")
    rng = np.random.default_rng(9)
    compared = 0
    for _ in range(CASES):
        low, most = float(10.0 ** rng.uniform(-30, 29)), int(rng.integers(2, 12))
        high = low * float(10.0 ** rng.uniform(0.1, 30))
        if kind == "log":
            ours, minors = find_log_ticks(low, high, most)
            locators = [ticker.LogLocator(numticks=most),
                        ticker.LogLocator(subs=range(2, 10), numticks=most)]  # fmt: skip
        else:
            width, low = low, -high * float(rng.uniform(-0.3, 1.0))
            ours, minors = find_symlog_ticks(low, high, width, most)
            locators = [ticker.SymmetricalLogLocator(base=10.0, linthresh=width)]
            locators[0].set_params(numticks=most + 1)
        theirs = [one.tick_values(low, high) for one in locators]
        theirs = [one[(one >= low) & (one <= high)].tolist() for one in theirs]
        if len(theirs[0]) > 1:
            compared += 1
            assert ours == pytest.approx(theirs[0], rel=1e-12)
            assert kind == "symlog" or minors == pytest.approx(theirs[1], rel=1e-12)
    assert compared > 0.8 * CASES


def test_pixels_show_the_colors_of_their_scalars():
    mesh = rj.Mesh(
        [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]],
        scalars=[-50.0, 1.0, 2000.0, 1.0], norm="log", range=(0.5, 800.0),
        colormap=rj.Colormap("turbo", under="white", over="black", bad="magenta"),
        material=rj.Material("unlit"),
    )  # fmt: skip
    frame = rj.render(mesh, size=(60, 60), outputs=("color", "scalar"), threads=1)
    shown = np.isfinite(frame.scalar)
    values = frame.scalar[shown].astype(float)
    wanted = codes(mesh.field, values)
    near = np.abs(values[:, None] / mesh.field.thresholds[1:] - 1.0).min(axis=1) < 1e-6
    assert np.array_equal(frame.color[shown][~near], wanted[~near])
    # All of them are in view: no colour, below, within and above.
    rows = mesh.field.entries(values)
    assert {0, 257, 258} <= set(rows.tolist())
    assert len(set(rows.tolist())) > 100


def test_meshes_of_one_scene_have_norms_of_their_own():
    corners, faces = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]
    options = {"scalars": [1.0, 10.0, 100.0], "material": rj.Material("unlit")}
    both = rj.Scene()
    for n, norm in enumerate((None, "log", None, "symlog")):
        both.add(rj.Mesh(corners, faces, norm=norm, **options), rj.transforms.translate((n, 0, 0)))
    camera = rj.fit_camera(both)
    together = rj.render(both, camera, size=(160, 60), threads=1).color
    looks = []
    for node in both.nodes:
        alone = rj.Scene()
        alone.add(node.mesh, node.transform)
        shown = rj.render(alone, camera, size=(160, 60), outputs=("color", "face_id"), threads=1)
        is_seen = shown.face_id >= 0
        assert is_seen.sum() > 50
        assert np.array_equal(together[is_seen], shown.color[is_seen])
        looks.append(shown.color[is_seen].mean(axis=0))
    assert min(np.abs(looks[n] - looks[n + 1]).max() for n in range(3)) > 20


def test_entries_of_logarithms_begin_at_numbers_rounded_once():
    starts = own_field([1.0, 1e4], norm="log").thresholds
    assert starts[[0, 1, 65, 129, 193]].tolist() == [5e-324, 1.0, 10.0, 100.0, 1000.0]
    starts = own_field([-200.0, 200.0], norm="symlog").thresholds
    assert starts[129] == 0.0
    assert np.array_equal(starts[2:257], -starts[256:1:-1])
    assert own_field([3.0, 3.0], norm="log").entries([2.9, 3.0, 3.1]).tolist() == [1, 1, 1]
    assert own_field([1.0, -1.0], norm="log").entries([1.0, 0.0, -1.0]).tolist() == [1, 258, 258]
    assert own_field([-1.0, -2.0], norm="log").has_nan


def test_ranges_are_fitted_without_a_share_of_the_values_at_each_end():
    values = np.append(np.arange(101.0), np.nan)
    assert own_field(values, range="2%").range == (2.0, 98.0)
    fitted = own_field(np.append(values, -np.arange(50.0)), range="10 %", norm="log").range
    assert fitted == pytest.approx((10.9, 90.1))
    assert own_field([np.nan], range="2%").range == (0.0, 1.0)
    assert own_field([-1.0, 0.0], norm="log").range == (1.0, 1.0)


def test_contours_are_spread_as_colors_are():
    field = own_field([1.0, 1e4], norm="log", contours=3)
    assert field.levels.tolist() == [10.0, 100.0, 1000.0]


def test_a_norm_of_matplotlib_stays_as_it_is():
    colors = pytest.importorskip("matplotlib.colors")
    norm = colors.LogNorm()
    field = own_field([1.0, 10.0, -1.0], norm=norm)
    assert (norm.vmin, norm.vmax) == (None, None)
    assert field.range == (1.0, 10.0)
    assert field.has_nan
    for one in (copy.deepcopy(field), pickle.loads(pickle.dumps(field))):
        assert np.array_equal(one.thresholds, field.thresholds)

    class Falling(colors.Normalize):
        def __call__(self, value, clip=None):
            return 1.0 - super().__call__(value, clip)

    with pytest.raises(ValueError, match="range must be None where norm has its own"):
        own_field([1.0, 2.0], norm=colors.Normalize(0, 1), range=(0, 2))
    with pytest.raises(ValueError, match="norm does not fit its range"):
        own_field([1.0, 2.0], norm=colors.LogNorm(-1, 1))
    with pytest.raises(ValueError, match="norm must not fall"):
        own_field([1.0, 2.0], norm=Falling(0, 1))
    for changed in (colors.TwoSlopeNorm(0), colors.CenteredNorm(0)):
        with pytest.raises(ValueError, match="range must be one that norm leaves as it is"):
            own_field([1.0, 2.0], norm=changed, range=(1, 10))
    with pytest.raises(ValueError, match=r"None where norm has its own, 1\.0 to None"):
        own_field([1.0, 2.0], norm=colors.LogNorm(vmin=1), range=(0.5, 10))
    for given, own in ((colors.LogNorm(), "log"), (colors.Normalize(), "linear")):
        scales = [own_field([1.0, 10.0], norm=one).scale for one in (given, own)]
        assert scales[0].equals(scales[1])


class Limited:
    """Something that looks like a norm at first."""

    vmin, vmax = 0.0, 1.0

    def __call__(self, values):
        return "text"


class Open(Limited):
    vmin = None


class Endless(Limited):
    vmax = property()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"norm": "logg"}, "norm must be one of 'linear', 'log', 'symlog'"),
        ({"norm": 3}, "norm must be one of"),
        ({"norm": ("log", 3)}, "norm must be one of"),
        ({"norm": ("symlog", 0)}, r"norm\[1\] must be above 0"),
        ({"norm": "log", "range": (0, 1)}, "range must be above 0 where norm is 'log'"),
        ({"range": "2"}, "such as '2%'"),
        ({"range": "50%"}, "below 50%"),
        ({"norm": Limited()}, "norm does not fit its range: could not convert"),
        ({"norm": Open()}, "norm does not fit its range: .* no attribute 'autoscale_None'"),
        ({"norm": Endless()}, "norm does not fit its range"),
        ({"colormap": {"a": "red"}, "norm": "log"}, "norm must be None where colormap has categ"),
        ({"colormap": {}}, "colormap must have a name"),
        ({"colormap": {"a": "reddish"}}, r"colormap\['a'\]"),
    ],
)
def test_what_is_no_norm_is_refused_by_name(options, words):
    with pytest.raises(ValueError, match=words):
        own_field([1.0, 2.0], **options)


def test_categories_have_their_names_and_numbers():
    mapping = {"bone": "ivory", "muscle": "#b22222", "fat": "gold"}
    field = own_field([0, 2, 2, 0], rj.Colormap(mapping))
    assert field.colormap.categories == ("bone", "muscle", "fat")
    assert field.range == (-0.5, 2.5)
    assert field.entries([0, 1, 2]).tolist() == [0, 1, 2]
    assert field.colormap.codes[1].tolist() == [0xB2, 0x22, 0x22, 255]


def test_opacities_run_from_the_lowest_to_the_highest_value():
    clear = rj.Colormap("gray", opacity=(0.0, 1.0, 0.5))
    assert clear.codes[[0, 51, 127, 255], 3].tolist() == [0, 102, 254, 128]
    assert np.array_equal(clear.codes[:, :3], rj.Colormap("gray").codes[:, :3])
    with pytest.raises(ValueError, match="opacity must be one number or more in 0"):
        rj.Colormap("gray", opacity=(0.0, 1.5))
