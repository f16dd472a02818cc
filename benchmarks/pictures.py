"""Pictures of where a caster disagrees with mj_ray: the scene in grey by distance, disagreements in colour."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from judged import Batch
from PIL import Image, ImageDraw

from rigcast.bench.casters import Floats
from rigcast.oracle import Comparison, Verdict

SIZE = (240, 160)  # width, height [pixels]
MARGIN = 14  # above each picture, for its title [pixels]
WRONG, EDGE = (230, 30, 30), (255, 170, 0)
Bytes = npt.NDArray[np.uint8]


def view(eye: Floats, at: Floats, fov_y_deg: float = 60.0) -> Floats:
    """Return unit directions (H * W, 3), row by row, of a pinhole camera at `eye` that looks at `at`, +z up."""
    width, height = SIZE
    forward = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    half = np.tan(np.radians(fov_y_deg) / 2)
    across, up = np.meshgrid(
        (np.arange(width) + 0.5 - width / 2) / (height / 2), (height / 2 - np.arange(height) - 0.5) / (height / 2)
    )
    rays = forward + half * (across[..., None] * right + up[..., None] * np.cross(right, forward))
    unit: Floats = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).reshape(-1, 3)
    return unit


def picture(batch: Batch, found: Comparison) -> Bytes:
    """Return (H, W, 3) bytes: grey where the caster agrees, darker farther away; red wrong, orange in the edge band."""
    expected = found.expected
    facing = np.abs((expected.normal * batch.directions).sum(axis=1))
    hit = np.isfinite(expected.distance)
    near, far = (np.quantile(expected.distance[hit], q) for q in (0.01, 0.99))
    depth = np.log(np.clip(expected.distance, near, far) / near) / np.log(far / near)
    grey = np.where(hit, 235 - 110 * depth - 60 * (1 - facing), 20)
    image = np.repeat(grey[:, None], 3, axis=1)
    image[found.verdict == Verdict.EDGE] = EDGE
    image[found.verdict == Verdict.WRONG] = WRONG
    return image.reshape(SIZE[1], SIZE[0], 3).astype(np.uint8)


def sheet(pictures: Mapping[str, Bytes]) -> Image.Image:
    """Return titled pictures in rows of two."""
    width, height = SIZE
    lines = (len(pictures) + 1) // 2
    page = Image.new("RGB", (2 * width + 4, lines * (height + MARGIN)), "white")
    draw = ImageDraw.Draw(page)
    for i, (title, pixels) in enumerate(pictures.items()):
        x, y = i % 2 * (width + 4), i // 2 * (height + MARGIN)
        draw.text((x + 2, y + 1), title, fill="black")
        page.paste(Image.fromarray(pixels), (x, y + MARGIN))
    return page
