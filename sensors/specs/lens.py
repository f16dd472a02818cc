"""Lenses as OpenCV defines them: the image point of a ray, and the ray of an image point.

Points are on the normalised image plane: a pixel (u, v) is at ((u - cx) / fx, (v - cy) / fy). There a pinhole, to
which a camera without distortion comes down, shows the ray (x, y, z) at (x / z, y / z).
"""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from rigcast.sensors.specs.spec import Spec

_STEPS = 100  # of Newton's method; it takes 3 to 10 where there is a solution
_TOLERANCE = 1e-13  # on the normalised image plane
_FOLD_SAMPLES = 33


class BrownConrady(Spec):
    """The lens of most cameras: radial and tangential distortion. Without k4, k5 and k6 it is ROS's "plumb_bob".

    With (x, y) = (X / Z, Y / Z) and r^2 = x^2 + y^2 a ray (X, Y, Z) is seen at

        x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
        y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

    which is OpenCV's `cv2.projectPoints` with 4, 5 or 8 coefficients.

    >>> BrownConrady(k1=-0.055, k2=0.066, p1=0.0006, p2=-0.0009, k3=-0.021)
    """

    type: Literal["brown_conrady"] = "brown_conrady"
    k1: float = Field(default=0.0, description="radial, of r^2")
    k2: float = Field(default=0.0, description="radial, of r^4")
    p1: float = Field(default=0.0, description="tangential")
    p2: float = Field(default=0.0, description="tangential")
    k3: float = Field(default=0.0, description="radial, of r^6")
    k4: float = Field(default=0.0, description="radial, of r^2 in the denominator")
    k5: float = Field(default=0.0, description="radial, of r^4 in the denominator")
    k6: float = Field(default=0.0, description="radial, of r^6 in the denominator")

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """The coefficients (8,) k1 k2 p1 p2 k3 k4 k5 k6, in OpenCV's order."""
        return np.array([self.k1, self.k2, self.p1, self.p2, self.k3, self.k4, self.k5, self.k6])

    def distort(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Image points (..., 2) of rays (..., 3) of any length with z > 0."""
        return self._map(directions[..., :2] / directions[..., 2:])[0]

    def undistort(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Unit directions (..., 3) of the rays imaged at points (..., 2); NaN where there is none.

        The residual is below 1e-13. Of several rays that a folding polynomial images at one point, only the
        one within the fold around the centre counts.
        """
        with np.errstate(all="ignore"):  # the polynomial overflows far out, where there is no ray
            ideal = self._solve(points)
            rays = np.concatenate([ideal, np.ones((*points.shape[:-1], 1))], axis=-1)
            return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def _solve(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Newton's method in two dimensions; NaN where it does not converge or crosses a fold."""
        ideal = points.copy()
        for _ in range(_STEPS):
            image, jacobian = self._map(ideal)
            residual = image - points
            if not (np.abs(residual) > _TOLERANCE).any():
                break
            ideal -= _solve_2x2(jacobian, residual)
        residual = np.abs(self._map(ideal)[0] - points).max(axis=-1)
        found = residual <= 2 * _TOLERANCE
        for share in np.linspace(0, 1, _FOLD_SAMPLES):
            found &= _determinant(self._map(share * ideal)[1]) > 0
        return np.where(found[..., None], ideal, np.nan)

    def _map(self, ideal: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The distorted points (..., 2) of undistorted ones, and the Jacobian (..., 2, 2)."""
        x, y = ideal[..., 0], ideal[..., 1]
        r2 = x * x + y * y
        above, above_slope = _cubic(r2, self.k1, self.k2, self.k3)
        below, below_slope = _cubic(r2, self.k4, self.k5, self.k6)
        radial = above / below
        slope = 2 * (above_slope - radial * below_slope) / below  # d radial / dx = slope x
        image = np.stack(
            [
                x * radial + 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x),
                y * radial + self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y,
            ],
            axis=-1,
        )
        mixed = slope * x * y + 2 * self.p1 * x + 2 * self.p2 * y
        jacobian = np.empty((*ideal.shape, 2))
        jacobian[..., 0, 0] = radial + slope * x * x + 2 * self.p1 * y + 6 * self.p2 * x
        jacobian[..., 1, 1] = radial + slope * y * y + 6 * self.p1 * y + 2 * self.p2 * x
        jacobian[..., 0, 1] = jacobian[..., 1, 0] = mixed
        return image, jacobian


class KannalaBrandt(Spec):
    """A fisheye lens: a ray at angle theta to the axis is seen at distance theta_d from the centre,

        theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)

    which is OpenCV's `cv2.fisheye` and ROS's "equidistant", beyond 90 deg too. Pixels farther out than any ray is
    seen look nowhere and read NaN.

    >>> KannalaBrandt(k1=-0.012, k2=0.041, k3=-0.035, k4=0.0077)
    """

    type: Literal["kannala_brandt"] = "kannala_brandt"
    k1: float = Field(default=0.0, description="of theta^2")
    k2: float = Field(default=0.0, description="of theta^4")
    k3: float = Field(default=0.0, description="of theta^6")
    k4: float = Field(default=0.0, description="of theta^8")

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """The coefficients (4,) k1 k2 k3 k4, in OpenCV's order."""
        return np.array([self.k1, self.k2, self.k3, self.k4])

    def distort(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Image points (..., 2) of rays (..., 3) of any length."""
        across = np.linalg.norm(directions[..., :2], axis=-1)
        theta = np.arctan2(across, directions[..., 2])
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(across > 0, self._image_radius(theta) / across, 0.0)
        return scale[..., None] * directions[..., :2]

    def undistort(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Unit directions (..., 3) of the rays imaged at points (..., 2); NaN where there is none."""
        radius = np.linalg.norm(points, axis=-1)
        theta = self._angle(radius)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(radius > 0, np.sin(theta) / radius, 1.0)
        return np.concatenate([scale[..., None] * points, np.cos(theta)[..., None]], axis=-1)

    def _image_radius(self, theta: NDArray[np.float64]) -> NDArray[np.float64]:
        t2 = theta * theta
        return theta * (1 + t2 * (self.k1 + t2 * (self.k2 + t2 * (self.k3 + t2 * self.k4))))

    def _angle(self, radius: NDArray[np.float64]) -> NDArray[np.float64]:
        """The angle theta for theta_d, by bisection of the interval in which theta_d grows, down to one float64."""
        low, high = np.zeros_like(radius), np.full_like(radius, self._widest())
        inside = radius <= self._image_radius(high)
        for _ in range(60):
            middle = 0.5 * (low + high)
            is_below = self._image_radius(middle) < radius
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        return np.where(inside, high, np.nan)

    def _widest(self) -> float:
        """The angle [rad] up to which theta_d grows with theta: the first root of its derivative, at most 180 deg."""
        roots = np.roots([9 * self.k4, 0, 7 * self.k3, 0, 5 * self.k2, 0, 3 * self.k1, 0, 1])
        real = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
        return float(min([np.pi, *real]))


Lens = BrownConrady | KannalaBrandt
AnyLens = Annotated[Lens, Field(discriminator="type")]


def _cubic(r2: NDArray[np.float64], a: float, b: float, c: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The polynomial 1 + a r^2 + b r^4 + c r^6 and its derivative by r^2."""
    return 1 + r2 * (a + r2 * (b + r2 * c)), a + r2 * (2 * b + r2 * 3 * c)


def _determinant(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    return matrices[..., 0, 0] * matrices[..., 1, 1] - matrices[..., 0, 1] * matrices[..., 1, 0]


def _solve_2x2(matrices: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve `matrices` x = `right` for x by Cramer's rule."""
    x = right[..., 0] * matrices[..., 1, 1] - right[..., 1] * matrices[..., 0, 1]
    y = matrices[..., 0, 0] * right[..., 1] - matrices[..., 1, 0] * right[..., 0]
    return np.stack([x, y], axis=-1) / _determinant(matrices)[..., None]
