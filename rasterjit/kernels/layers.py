"""
Lay the colours of a pixel over each other, or mix them, in linear light.

What is summed up is premultiplied: colour times alpha. What changes nothing leaves every bit of a
colour as it is: a layer with alpha 0, what lies behind one with alpha 1, and the mean of samples
that all show the same.

With several samples a pixel shows several faces, each shaded once. `find_shares` lists them with
the share of the samples that show them; where something is transparent, the share of a face depends
on the alpha of those before it, and `list_faces` keeps for each sample which faces it shows.

References
----------
.. [1] T. Porter and T. Duff, "Compositing Digital Images", SIGGRAPH 1984: the over operator.
"""

from __future__ import annotations

import numpy as np

from rasterjit.kernels.jit import disjoint_stage, kernel, stage
from rasterjit.kernels.visibility import NOTHING

FILLED_COLUMNS = 8
"""Columns of a gap between faces that is filled."""

THROUGH = 3
"""Column of a sum: the share of light that comes through from behind."""


@stage
def held_alpha(alpha):
    """Return an alpha held in 0..1; NaN gives 0."""
    alpha = alpha if alpha > np.float32(0.0) else np.float32(0.0)
    return alpha if alpha < np.float32(1.0) else np.float32(1.0)


@kernel
def start_sums(sums):
    """
    Begin with nothing in front.

    Parameters
    ----------
    sums : (R, W, 4) float32
        Written.
    """
    for row in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            for k in range(3):
                sums[row, i, k] = 0.0
            sums[row, i, THROUGH] = 1.0


@kernel
def lay_under(colors, faces, behind, sums):
    """
    Lay a layer behind those that were laid before.

    Parameters
    ----------
    colors : (R, W, 4) float32, linear, with alpha
    faces : (R, W) int32
        The faces of the layer, -1 where there is none.
    behind : (R, W) int32
        Those of the next layer; -1 is written where nothing comes through to it.
    sums : (R, W, 4) float32
        Changed: premultiplied colour, and the share of light that comes through.
    """
    one, none = np.float32(1.0), np.float32(0.0)
    for row in range(faces.shape[0]):
        for i in range(faces.shape[1]):
            through = sums[row, i, THROUGH]
            if faces[row, i] >= 0:
                alpha = held_alpha(colors[row, i, 3])
                share = through * alpha
                # What is not seen is not multiplied: its colour may be infinite.
                if share > none:
                    for k in range(3):
                        sums[row, i, k] += share * colors[row, i, k]
                    through *= one - alpha
                    sums[row, i, THROUGH] = through
            if through == none:
                behind[row, i] = NOTHING


@stage
def over_background(total, through, color):
    """Return straight RGBA of a premultiplied sum over a colour with straight alpha."""
    one, none = np.float32(1.0), np.float32(0.0)
    if through == none:
        return total[0], total[1], total[2], one
    alpha = one - through * (one - color[3])
    if alpha == none:
        return color[0], color[1], color[2], none
    share = through * color[3]
    if share == none:
        return total[0] / alpha, total[1] / alpha, total[2] / alpha, alpha
    return (
        (total[0] + share * color[0]) / alpha,
        (total[1] + share * color[1]) / alpha,
        (total[2] + share * color[2]) / alpha,
        alpha,
    )


@kernel
def finish_sums(sums, linear):
    """
    Lay the sums over what lies behind all layers.

    Parameters
    ----------
    sums : (R, W, 4) float32
        As `lay_under` leaves them.
    linear : (R, W, 4) float32
        Opaque surfaces and background; changed where a layer lies before it.
    """
    for row in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            through = sums[row, i, THROUGH]
            if through == np.float32(1.0):
                continue
            total = sums[row, i, 0], sums[row, i, 1], sums[row, i, 2]
            own = linear[row, i, 0], linear[row, i, 1], linear[row, i, 2], linear[row, i, 3]
            shown = over_background(total, through, own)
            for k in range(4):
                linear[row, i, k] = shown[k]


@disjoint_stage
def note_differences(first, other, differences):
    """Note where a sample shows another face than the first one."""
    for i in range(first.shape[0]):
        differences[i] |= np.int32(first[i] ^ other[i])


@disjoint_stage
def show_first(faces, shown, shares, rest):
    """Write what pixels show if all samples show the face of the first one."""
    one, none = np.float32(1.0), np.float32(0.0)
    for i in range(faces.shape[0]):
        shown[i] = faces[i]
        shares[i] = none if faces[i] < 0 else one
        rest[i] = one if faces[i] < 0 else none


@disjoint_stage
def empty_row(faces):
    """Mark a row of a layer as empty."""
    for i in range(faces.shape[0]):
        faces[i] = NOTHING


@stage
def share_pixel(opaque, shown, shares, rest, row, i, most):
    """List the faces of a pixel with their shares; return the most faces in a pixel so far."""
    samples = opaque.shape[0]
    part, none = np.float32(1.0) / np.float32(samples), np.float32(0.0)
    count, empty = np.int64(0), none
    for sample in range(samples):
        face = opaque[sample, row, i]
        if face < 0:
            empty += part
            continue
        layer = np.int64(0)
        while layer < count and shown[layer, row, i] != face:
            layer += 1
        if layer == count:
            if layer == most:
                # A layer more than any row had so far: empty in all of them.
                for above in range(row + 1):
                    empty_row(shown[layer, above])
                most += 1
            shown[layer, row, i] = face
            shares[layer, row, i] = none
            count += 1
        shares[layer, row, i] += part
    rest[row, i] = empty
    return most


@stage
def fill_gaps(faces, shares):
    """
    Fill gaps of a few columns with the face before them, and a share of 0.

    Neighbours are shaded together, which is faster than to begin anew behind each gap.
    """
    last = np.int64(-FILLED_COLUMNS - 1)
    for i in range(faces.shape[0]):
        face = faces[np.uintp(i)]
        if face >= 0:
            if i - last <= FILLED_COLUMNS:
                for k in range(last + 1, i):
                    faces[np.uintp(k)] = faces[np.uintp(last)]
                    shares[np.uintp(k)] = np.float32(0.0)
            last = i


@kernel
def find_shares(opaque, shown, shares, rest, differences):
    """
    List the faces that the samples of each pixel show, and which share of them does.

    Parameters
    ----------
    opaque : (N, R, W) int32
        The face at each sample, -1 where there is none.
    shown : (N, R, W) int32
        Written: the different faces of each pixel, in the order of the first sample that shows
        them; -1 behind the last, or any face with a share of 0. As many layers as the pixels need.
    shares : (N, R, W) float32
        Written: their shares of the samples, in 0..1; for a face -1 anything.
    rest : (R, W) float32
        Written: the share that shows no face.
    differences : (W,) int32
        Scratch memory, all 0; left so.

    Returns
    -------
    int
        The most faces in a pixel.
    """
    samples, rows, columns = opaque.shape
    most = np.int64(1)
    for row in range(rows):
        for layer in range(1, most):
            empty_row(shown[layer, row])
        for sample in range(1, samples):
            note_differences(opaque[0, row], opaque[sample, row], differences)
        show_first(opaque[0, row], shown[0, row], shares[0, row], rest[row])
        differing = np.int32(0)
        for i in range(columns):
            differing |= differences[np.uintp(i)]
        for i in range(columns if differing != 0 else 0):
            if differences[np.uintp(i)] != 0:
                differences[np.uintp(i)] = 0
                most = share_pixel(opaque, shown, shares, rest, row, i, most)
        for layer in range(1, most):
            fill_gaps(shown[layer, row], shares[layer, row])
    return most


@stage
def is_mixed(share, rest):
    """Return whether a pixel shows more than one face, or a face and what is behind all."""
    one = np.float32(1.0)
    return (share != one) & (rest != one)


@stage
def seen_share(share, value):
    """Return a share of a value, which may be infinite if the share is 0."""
    none = np.float32(0.0)
    return share * value if share > none else none


@disjoint_stage
def start_mixed_row(behind, shares, rest, linear):
    """Begin to mix a row of pixels, four numbers each; without branches."""
    for i in range(rest.shape[0]):
        own, other = shares[i], rest[i]
        mixed = is_mixed(own, other)
        at = np.uintp(4 * i)
        red, green, blue = linear[at], linear[at + np.uintp(1)], linear[at + np.uintp(2)]
        alpha, through = linear[at + np.uintp(3)], other * behind[at + np.uintp(3)]
        red1 = own * red + seen_share(through, behind[at])
        green1 = own * green + seen_share(through, behind[at + np.uintp(1)])
        blue1 = own * blue + seen_share(through, behind[at + np.uintp(2)])
        linear[at] = red1 if mixed else red
        linear[at + np.uintp(1)] = green1 if mixed else green
        linear[at + np.uintp(2)] = blue1 if mixed else blue
        linear[at + np.uintp(3)] = np.float32(1.0) - (other - through) if mixed else alpha


@kernel
def start_mix(behind, shares, rest, linear):
    """
    Begin to mix the faces of each pixel.

    Parameters
    ----------
    behind : (R, W, 4) float32, linear, straight alpha
        What is seen where no face is.
    shares, rest : (R, W) float32
        The shares of the first layer and of what is behind.
    linear : (R, W, 4) float32
        The first layer shaded; changed where a pixel is mixed: its share, premultiplied.
    """
    for row in range(rest.shape[0]):
        start_mixed_row(behind[row].reshape(-1), shares[row], rest[row], linear[row].reshape(-1))


@kernel
def add_shares(colors, faces, shares, linear):
    """
    Add the shares of a layer to the mix.

    Parameters
    ----------
    colors : (R, W, 4) float32, linear
    faces : (R, W) int32
    shares : (R, W) float32
        Read where there is a face; one with a share of 0 adds nothing.
    linear : (R, W, 4) float32
        Changed.
    """
    for row in range(faces.shape[0]):
        for i in range(faces.shape[1]):
            if faces[row, i] >= 0:
                share = shares[row, i]
                for k in range(3):
                    linear[row, i, k] += seen_share(share, colors[row, i, k])


@disjoint_stage
def divide_row(shares, rest, linear):
    """Divide the mixed pixels of a row, four numbers each, by their alpha; without branches."""
    one, none = np.float32(1.0), np.float32(0.0)
    for i in range(rest.shape[0]):
        at = np.uintp(4 * i)
        alpha = linear[at + np.uintp(3)]
        is_divided = is_mixed(shares[i], rest[i]) & (none < alpha) & (alpha < one)
        alpha = alpha if is_divided else one
        linear[at] /= alpha
        linear[at + np.uintp(1)] /= alpha
        linear[at + np.uintp(2)] /= alpha


@kernel
def finish_mix(shares, rest, linear):
    """
    Divide what was mixed by its alpha.

    Parameters
    ----------
    shares, rest : (R, W) float32
        As `start_mix` takes them.
    linear : (R, W, 4) float32
        Changed: straight alpha.
    """
    for row in range(rest.shape[0]):
        divide_row(shares[row], rest[row], linear[row].reshape(-1))


@stage
def number_of(face, shown, count, row, i):
    """Return the number of a face among those of a pixel, which it joins if it is not there."""
    if face < 0:
        return np.int32(NOTHING), count
    layer = np.int64(0)
    while layer < count and shown[layer, row, i] != face:
        layer += 1
    if layer == count:
        shown[layer, row, i] = face
        count += 1
    return np.int32(layer), count


@kernel
def list_faces(opaque, transparent, shown):
    """
    List the faces that the samples of each pixel show, and number them.

    Parameters
    ----------
    opaque : (N, R, W) int32
        The opaque face at each sample; -1 where there is none. Replaced by its number.
    transparent : (N, K, R, W) int32
        The transparent faces before it, nearest first. Replaced by their numbers.
    shown : (N (K + 1), R, W) int32
        Written: the different faces of each pixel, -1 behind the last.

    Returns
    -------
    int
        The most faces in a pixel.
    """
    samples, levels, rows, columns = transparent.shape
    most = np.int64(0)
    for row in range(rows):
        for layer in range(shown.shape[0]):
            empty_row(shown[layer, row])
        for i in range(columns):
            count = np.int64(0)
            for sample in range(samples):
                for level in range(levels):
                    face = transparent[sample, level, row, i]
                    number, count = number_of(face, shown, count, row, i)
                    transparent[sample, level, row, i] = number
                number, count = number_of(opaque[sample, row, i], shown, count, row, i)
                opaque[sample, row, i] = number
            most = max(most, count)
    return most


@stage
def are_alike(opaque, transparent, row, i):
    """Return whether all samples of a pixel show the same faces in the same order."""
    for sample in range(1, opaque.shape[0]):
        if opaque[sample, row, i] != opaque[0, row, i]:
            return False
        for level in range(transparent.shape[1]):
            if transparent[sample, level, row, i] != transparent[0, level, row, i]:
                return False
    return True


@stage
def sample_color(sample, opaque, transparent, colors, behind, row, i):
    """Return what a sample shows, linear RGBA with straight alpha."""
    one, none = np.float32(1.0), np.float32(0.0)
    red, green, blue, through = none, none, none, one
    for level in range(transparent.shape[1]):
        layer = transparent[sample, level, row, i]
        if layer < 0:
            break
        alpha = held_alpha(colors[layer, row, i, 3])
        share = through * alpha
        if share > none:
            red += share * colors[layer, row, i, 0]
            green += share * colors[layer, row, i, 1]
            blue += share * colors[layer, row, i, 2]
            through *= one - alpha
    layer = opaque[sample, row, i]
    if layer >= 0:
        own = colors[layer, row, i, 0], colors[layer, row, i, 1], colors[layer, row, i, 2], one
    else:
        own = behind[row, i, 0], behind[row, i, 1], behind[row, i, 2], behind[row, i, 3]
    if through == one:
        return own
    return over_background((red, green, blue), through, own)


@kernel
def mix_samples(opaque, transparent, colors, behind, linear):
    """
    Write the mean of what the samples of each pixel show.

    Parameters
    ----------
    opaque : (N, R, W) int32
    transparent : (N, K, R, W) int32
        Numbers of faces, from `list_faces`.
    colors : (J, R, W, 4) float32
        The colours of these faces in each pixel.
    behind : (R, W, 4) float32
        What is seen where no face is.
    linear : (R, W, 4) float32
        Written: linear RGBA with straight alpha.
    """
    samples, none = opaque.shape[0], np.float32(0.0)
    part = np.float32(1.0) / np.float32(samples)
    for row in range(linear.shape[0]):
        for i in range(linear.shape[1]):
            shown = sample_color(0, opaque, transparent, colors, behind, row, i)
            if not are_alike(opaque, transparent, row, i):
                red, green, blue, alpha = none, none, none, none
                for sample in range(samples):
                    shown = sample_color(sample, opaque, transparent, colors, behind, row, i)
                    share = part * shown[3]
                    red += seen_share(share, shown[0])
                    green += seen_share(share, shown[1])
                    blue += seen_share(share, shown[2])
                    alpha += share
                scale = alpha if alpha > none else np.float32(1.0)
                shown = red / scale, green / scale, blue / scale, alpha
            for k in range(4):
                linear[row, i, k] = shown[k]
