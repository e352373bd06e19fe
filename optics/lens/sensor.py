"""The camera's sensor: image to counts, with noise, and back to light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from microplan.arrays import FloatArray
from microplan.optics.lens.response import Response

CountArray = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
ROUNDING = 1 / 12  # variance of rounding, counts squared


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """Numbers of one sensor; at gain 1 full well is full scale of the light.

    Where `noise` is stated, the variance of counts at each level, it stands for photon
    and read noise. The pattern is fixed to the pixels: what differs from one to the
    next, and not from frame to frame.
    """

    full_well_e: float
    read_noise_e: float  # one standard deviation
    bits: int
    gain: float = 1.0  # full well over the electrons that give the top count [1]
    response: Response | None = None  # None: straight, from 0 to the top count
    noise: tuple[tuple[float, float], ...] = ()  # count, variance with rounding; rising
    pattern_gain: float = 0.0  # one standard deviation of pixels' gain [1]
    pattern_counts: float = 0.0  # one standard deviation of pixels' offset, counts

    def __post_init__(self) -> None:
        if not (self.full_well_e > 0 and math.isfinite(self.full_well_e)):
            raise ValueError(f"full_well_e must be positive, got {self.full_well_e}")
        for name in ("read_noise_e", "pattern_gain", "pattern_counts"):
            value = getattr(self, name)
            if not (value >= 0 and math.isfinite(value)):
                raise ValueError(f"{name} must be finite and >= 0, got {value}")
        if not 1 <= self.bits <= 16:
            raise ValueError(f"bits must be in 1..16, got {self.bits}")
        if not (self.gain > 0 and math.isfinite(self.gain)):
            raise ValueError(f"gain must be positive and finite, got {self.gain}")
        levels = [level for level, _ in self.noise]
        if levels != sorted(set(levels)) or any(not v >= 0 for _, v in self.noise):
            raise ValueError(f"noise must rise, no variance below 0, got {self.noise}")

    @property
    def top_count(self) -> int:
        """Return the largest count that the converter has, 2**bits - 1."""
        return int(2**self.bits - 1)

    @property
    def curve(self) -> Response:
        """Return the response, the straight one where none is stated."""
        straight = Response(shares=(0.0, 1.0), counts=(0.0, float(self.top_count)))
        return self.response or straight

    @property
    def is_plain(self) -> bool:
        """Return whether full well, read noise and rounding are all there is."""
        return not (
            self.response or self.noise or self.pattern_gain or self.pattern_counts
        )


def expose(image: FloatArray, sensor: Sensor, rng: np.random.Generator) -> CountArray:
    """Return one noisy frame.

    ValueError if the image holds a nan or infinity.

    Parameters
    ----------
    image : (...) float array
        Share of full well; below 0 counts as 0, above 1 saturates.
    rng : numpy.random.Generator
        Source of the noise; two arrays of the image's size are drawn from it, one for
        each kind of pattern besides.

    Returns
    -------
    (...) uint8 or uint16 array
        Counts 0..2**bits - 1, uint8 up to 8 bits. Above gain 1 full scale is reached
        at 1 / gain of full well; below it the well is full at gain times that.
    """
    if not np.isfinite(image).all():
        raise ValueError("image must be finite")
    light = np.clip(image, 0.0, 2.0)  # twice full well saturates just the same
    if sensor.is_plain:
        return _counted(_signal(light, sensor, rng) * sensor.top_count, sensor)
    if sensor.pattern_gain:
        light = light * np.maximum(
            1 + sensor.pattern_gain * rng.standard_normal(np.shape(image)), 0.0
        )
    curve = sensor.curve
    if sensor.noise:
        share = np.minimum(light, 1.0) * sensor.gain
        levels = curve.counts_of(share)
        variance = _variance(levels, sensor) - ROUNDING
        spread = np.where(share < 1, np.sqrt(variance), 0.0)  # else it is saturated
        counts = levels + spread * rng.standard_normal(np.shape(image))
    else:
        counts = curve.counts_of(_signal(light, sensor, rng))
    if sensor.pattern_counts:
        counts = counts + sensor.pattern_counts * rng.standard_normal(np.shape(image))
    return _counted(np.minimum(counts, curve.counts[-1]), sensor)


def linear(counts: CountArray, sensor: Sensor) -> FloatArray:
    """Return counts (...) as float64 shares of full scale of the light, at most 1.

    Below 0 where counts are below those of darkness.
    """
    if sensor.response is None:
        return to_unit(counts, sensor.bits)
    return sensor.response.share_of(np.asarray(counts, dtype=np.float64))


def quantised(image: FloatArray, sensor: Sensor) -> CountArray:
    """Return an image (...), shares of full scale, as counts, without more noise."""
    if sensor.response is None:
        return _counted(image * sensor.top_count, sensor)
    return _counted(sensor.response.counts_of(image), sensor)


def as_shown(image: FloatArray, sensor: Sensor) -> FloatArray:
    """Return an image (...), light, as mean counts over the top count, 0..1."""
    if sensor.response is None:
        return np.clip(image, 0.0, 1.0)
    return np.clip(sensor.response.counts_of(image) / sensor.top_count, 0.0, 1.0)


def to_unit(counts: CountArray, bits: int) -> FloatArray:
    """Return counts (...) as float64 shares of the top count, 0..1."""
    if not 1 <= bits <= 16:
        raise ValueError(f"bits must be in 1..16, got {bits}")
    unit: FloatArray = np.asarray(counts, dtype=np.float64) / (2**bits - 1)
    return unit


def ends(sensor: Sensor) -> tuple[float, float]:
    """Return the shares of full scale that give the least and the greatest count.

    0 and 1 of a straight response; 0 where darkness gives more than no count.
    """
    if sensor.response is None:
        return 0.0, 1.0
    low, high = sensor.response.counts[0], sensor.response.counts[-1]
    least, most = sensor.response.share_of(np.array([0.5, high - 0.5])).tolist()
    return (least if low <= 0 else 0.0), most


def noise_rows(sensor: Sensor) -> tuple[tuple[float, float], ...]:
    """Return shares of full scale and the variance of `linear` there, rising.

    For a sensor that is not plain. Noise of counts, normal and cut off where counts
    end, is taken back through the response at Gauss-Hermite nodes; where no light is
    told from none, or from more, it is that of the last count that comes.
    """
    curve = sensor.curve
    stated = curve.share_of(np.array([level for level, _ in sensor.noise]))
    even = np.linspace(0.0, 1.0, _EVEN) ** 2
    shares = np.unique(np.clip(np.concatenate((even, curve.shares, stated)), 0.0, 1.0))
    highest = min(curve.counts[-1], float(sensor.top_count))
    levels = np.clip(curve.counts_of(shares), 0.5, highest - 0.5)
    own = _variance(levels, sensor) if sensor.noise else np.full_like(levels, ROUNDING)
    spread = np.sqrt(own + sensor.pattern_counts**2)
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    counts = np.clip(levels + spread * nodes[:, None], 0.0, highest)
    lights = curve.share_of(counts)
    weights = weights / weights.sum()
    variance = weights @ lights**2 - (weights @ lights) ** 2
    variance += (sensor.pattern_gain * shares) ** 2
    if not sensor.noise:
        well_e = sensor.full_well_e / sensor.gain
        variance += shares / well_e + (sensor.read_noise_e / well_e) ** 2
    return tuple(zip(shares.tolist(), variance.tolist(), strict=True))


_EVEN = 33  # shares besides those at which the response bends or noise is stated
_NODES = 15  # of a normal density


def _signal(light: FloatArray, sensor: Sensor, rng: np.random.Generator) -> FloatArray:
    """Return light with photon and read noise, as a share of full scale."""
    electrons = rng.poisson(light * sensor.full_well_e).astype(np.float64)
    if sensor.gain < 1:  # else the converter is at its top before
        electrons = np.minimum(electrons, sensor.full_well_e)
    electrons += sensor.read_noise_e * rng.standard_normal(np.shape(light))
    share: FloatArray = electrons / sensor.full_well_e * sensor.gain
    return share


def _variance(levels: FloatArray, sensor: Sensor) -> FloatArray:
    """Return the stated variance of counts (...) at levels (...), rounding at least."""
    found: FloatArray = np.interp(levels, *np.transpose(sensor.noise))
    return np.maximum(found, ROUNDING)


def _counted(counts: FloatArray, sensor: Sensor) -> CountArray:
    """Return counts (...) rounded, between 0 and the top count."""
    whole = np.clip(np.rint(counts), 0, sensor.top_count)
    return whole.astype(np.uint8) if sensor.bits <= 8 else whole.astype(np.uint16)
