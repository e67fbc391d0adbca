"""Recording -> bias polynomial, scale-factor polynomial, intervals, and how well held-out branches are predicted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wineglass.calibration.branches import Branch, find_branches
from wineglass.calibration.lag import Lag
from wineglass.calibration.model import Basis, Model, Terms, fit, needs_delay
from wineglass.calibration.noise import Interval, LeastSquares
from wineglass.calibration.observations import Observations
from wineglass.calibration.order import HeldOut, OrderChoice, after_maximum, choose, hold_out, hold_out_branches
from wineglass.errors import BadInput

MAX_ORDER = 5  # what the firmware's polynomial holds
MIN_SPAN_DEGC = 10.0
MAX_CONDITION = 1e4  # of the column-scaled design; above it the highest coefficient is not told apart from the others
BLOCKS = 150  # block means per record for the noise, more where there are many branches
BLOCKS_PER_BRANCH = 40
SETTLE_TAUS = 6.0
MIN_SCALE_PRECISION = 0.2


@dataclass(frozen=True)
class Settings:
    """order, scale_order: None to choose; tau_s and gain: functions of temperature [degC] (n,) -> (n,), None for no lag, constant gain"""

    reference_temperature_degc: float = 25.0
    order: int | None = None
    scale_order: int | None = None
    max_order: int = MAX_ORDER
    min_span_degc: float = MIN_SPAN_DEGC
    tau_s: Callable[[np.ndarray], np.ndarray] | None = None
    gain: Callable[[np.ndarray], np.ndarray] | None = None
    delay_s: float = 0.0
    """of the output filter, for rate channels"""


@dataclass(frozen=True)
class Identified:
    """Coefficients of shift^i from the reference temperature; half widths of their 95 % intervals beside them."""

    channel: str
    order: int
    bias_rad_s: np.ndarray
    bias_half_width_rad_s: np.ndarray
    scale: np.ndarray | None
    """rad/s per unit of ratio, or (rate channels) the factor to be put on the present scale factor; None where no rate moved"""
    scale_half_width: np.ndarray | None
    scale_is_ratio: bool
    delay_s: float | None
    """by which the channel follows the temperature (and the true rate) later than its known lag; None: none is seen, or not looked for"""
    delay_half_width_s: float | None
    reference_temperature_degc: float
    temperature_min_degc: float
    temperature_max_degc: float
    residual_rms: float
    noise: Interval
    samples: int
    blocks: int
    branches: list[Branch]
    choice: OrderChoice | None
    scale_choice: OrderChoice | None
    after_maximum: HeldOut | None
    """scored with the chosen orders only"""


def identify(data: Observations, settings: Settings, advance: Callable[[], None] = lambda: None) -> Identified:
    """Raises BadInput where the recording cannot carry what is asked."""
    _check_settings(settings)
    use = _usable(data, settings)
    model = _model(data, settings)
    branches = find_branches(data.temperature_degc)
    _check_span(data, use, settings)
    delay = _delay_is_seen(model, data, use, branches, settings)
    scale_order, scale_choice = _scale_order(model, data, use, branches, settings, delay, advance)
    order, choice = _bias_order(model, data, use, branches, settings, scale_order, delay, advance)
    terms = Terms(order, scale_order, delay and order > 0)
    theta = fit(model, terms, data.measured, use)
    return _result(model, data, use, branches, settings, terms, theta, choice, scale_choice)


def _check_settings(settings: Settings) -> None:
    for name, value in (("--order", settings.order), ("--scale-order", settings.scale_order), ("--max-order", settings.max_order)):
        if value is not None and not 0 <= value <= MAX_ORDER:
            raise BadInput(f"order {value} is not possible", name, f"the firmware holds orders 0 to {MAX_ORDER}")


def _check_span(data: Observations, use: np.ndarray, settings: Settings) -> None:
    span = float(np.ptp(data.temperature_degc[use]))
    if settings.order != 0 and span < settings.min_span_degc:
        raise BadInput(
            f"the temperature spans {span:.3g} degC, too little to identify a polynomial",
            f"channel {data.channel}",
            f"record at least {settings.min_span_degc:g} degC, or give --order 0 for a constant bias",
        )


def _usable(data: Observations, settings: Settings) -> np.ndarray:
    """Valid samples without the beginning and without the transients of rate steps, as far as enough is left."""
    time_s, tau = data.time_s, 0.0
    if settings.tau_s is not None:
        tau = float(np.max(settings.tau_s(data.temperature_degc)))
    first = time_s[int(np.argmax(data.valid))]
    use = data.valid & (time_s >= first + min(SETTLE_TAUS * tau, 0.1 * (time_s[-1] - first)))
    if not data.rate_moves:
        return use
    settled = use & ~_after_movement(time_s, data.true_rate_rad_s, SETTLE_TAUS * tau)
    turning = np.abs(data.true_rate_rad_s) > 0.1 * np.max(np.abs(data.true_rate_rad_s))
    enough = settled.sum() > 0.3 * use.sum() and (settled & turning).sum() > 0.2 * (use & turning).sum()
    return settled if enough else use


def _after_movement(time_s: np.ndarray, rate: np.ndarray, settle_s: float) -> np.ndarray:
    """Mask of samples while the true rate changes, one sample before, and until it has settled."""
    moves = np.abs(np.diff(rate)) > 1e-3 * np.ptp(rate)
    beside = np.concatenate((moves, [False])) | np.concatenate(([False], moves))
    last = np.maximum.accumulate(np.where(beside, np.arange(len(rate)), -1))
    since = np.where(last >= 0, time_s - time_s[np.maximum(last, 0)], np.inf)
    step = float(np.median(np.diff(time_s)))
    return since <= settle_s + 2.0 * step


def _model(data: Observations, settings: Settings) -> Model:
    shift = data.temperature_degc - settings.reference_temperature_degc
    none = np.zeros(len(shift))
    gain = np.ones(len(shift)) if settings.gain is None or data.is_ratio else settings.gain(data.temperature_degc)
    return Model(
        basis=Basis(shift),
        time_s=data.time_s,
        shift_degc=shift,
        true_rate_rad_s=none if data.true_rate_rad_s is None else data.true_rate_rad_s,
        gain=gain,
        lag=Lag(
            data.time_s,
            none if settings.tau_s is None else settings.tau_s(data.temperature_degc),
            0.0 if data.is_ratio else settings.delay_s,
        ),
    )


def _delay_is_seen(model: Model, data: Observations, use: np.ndarray, branches: list[Branch], settings: Settings) -> bool:
    """Only for a channel whose lag is modelled, and where heating and cooling tell a delay from a polynomial."""
    if settings.tau_s is None or len(branches) < 2 or settings.order == 0:
        return False
    order = settings.max_order if settings.order is None else settings.order
    scale_order = None
    if data.rate_moves:
        scale_order = settings.max_order if settings.scale_order is None else settings.scale_order
    return needs_delay(model, Terms(max(order, 1), scale_order), data.measured, use)


def _bias_order(
    model: Model,
    data: Observations,
    use: np.ndarray,
    branches: list[Branch],
    settings: Settings,
    scale_order: int | None,
    delay: bool,
    advance: Callable[[], None],
) -> tuple[int, OrderChoice | None]:
    choice = _choice(
        model, data, use, branches, settings.max_order, lambda order: Terms(order, scale_order, delay and order > 0), advance
    )
    if settings.order is not None:
        return settings.order, choice
    if choice is None:
        raise BadInput(
            f"the recording has {len(branches)} thermal branch{'' if len(branches) == 1 else 'es'} to hold out, the order cannot be chosen",
            f"channel {data.channel}",
            "give --order N, or record heating and cooling over the same temperatures",
        )
    return choice.order, choice


def _scale_order(
    model: Model,
    data: Observations,
    use: np.ndarray,
    branches: list[Branch],
    settings: Settings,
    delay: bool,
    advance: Callable[[], None],
) -> tuple[int | None, OrderChoice | None]:
    if not data.rate_moves:
        if data.is_ratio:
            raise BadInput("the true rate does not move, so the scale factor of the ratio is unknown", "reference/true_rate",
                           "record some turns, or choose --channel rate_uncompensated")
        return None, None
    if settings.scale_order is not None:
        return settings.scale_order, None
    bias_order = settings.max_order if settings.order is None else settings.order
    choice = _choice(model, data, use, branches, settings.max_order, lambda order: Terms(bias_order, order, delay), advance)
    if choice is None:
        raise BadInput("the scale factor's order cannot be chosen from one thermal branch", f"channel {data.channel}",
                       "give --scale-order N, or record heating and cooling over the same temperatures")
    return choice.order, choice


def _choice(
    model: Model,
    data: Observations,
    use: np.ndarray,
    branches: list[Branch],
    max_order: int,
    terms: Callable[[int], Terms],
    advance: Callable[[], None],
) -> OrderChoice | None:
    orders = range(max_order + 1)

    def errors(order: int, mask: np.ndarray) -> np.ndarray:
        advance()
        theta = fit(model, terms(order), data.measured, mask)
        return data.measured - model.evaluate(terms(order), theta)[0]

    held = hold_out_branches(errors, branches, use, data.time_s, data.temperature_degc, orders)
    if len(held) < 2:
        return None
    in_sample = [_rms(errors(order, use)[use]) for order in orders]
    return choose(held, in_sample, orders)


def _result(
    model: Model,
    data: Observations,
    use: np.ndarray,
    branches: list[Branch],
    settings: Settings,
    terms: Terms,
    theta: np.ndarray,
    choice: OrderChoice | None,
    scale_choice: OrderChoice | None,
) -> Identified:
    prediction, jacobian = model.evaluate(terms, theta)
    residual = data.measured - prediction
    blocks = block_means(use, max(BLOCKS, BLOCKS_PER_BRANCH * len(branches)), data.time_s, residual, jacobian)
    _check_condition(blocks[2], terms, data)
    powers = _to_powers(model, terms)
    interval = LeastSquares(blocks[0], blocks[2]).intervals(blocks[1], powers)
    coefficients = powers @ theta + interval.estimate
    bias, scale = slice(0, terms.bias + 1), slice(terms.bias + 1, terms.polynomials)
    has_scale = terms.scale is not None
    if has_scale:
        _check_scale(coefficients[scale], interval.half_width[scale])
    held = hold_out(
        lambda order, mask: data.measured - model.evaluate(terms, fit(model, terms, data.measured, mask))[0],
        after_maximum(data.temperature_degc), use, data.time_s, data.temperature_degc, "after the temperature maximum", range(1),
    )
    return Identified(
        channel=data.channel,
        order=terms.bias,
        bias_rad_s=coefficients[bias],
        bias_half_width_rad_s=interval.half_width[bias],
        scale=coefficients[scale] if has_scale else None,
        scale_half_width=interval.half_width[scale] if has_scale else None,
        scale_is_ratio=data.is_ratio,
        delay_s=float(coefficients[-1]) if terms.delay else None,
        delay_half_width_s=float(interval.half_width[-1]) if terms.delay else None,
        reference_temperature_degc=settings.reference_temperature_degc,
        temperature_min_degc=float(data.temperature_degc[use].min()),
        temperature_max_degc=float(data.temperature_degc[use].max()),
        residual_rms=_rms(residual[use]),
        noise=interval,
        samples=int(use.sum()),
        blocks=len(blocks[0]),
        branches=branches,
        choice=choice,
        scale_choice=scale_choice,
        after_maximum=held,
    )


def block_means(use: np.ndarray, count: int, *arrays: np.ndarray) -> list[np.ndarray]:
    """Means of each array (n, ...) over `count` equal stretches of the record; stretches that are less than half used are left out."""
    edges = np.unique(np.linspace(0, len(use), min(count, int(use.sum())) + 1).astype(int))
    used = np.add.reduceat(use.astype(float), edges[:-1])
    keep = used >= 0.5 * np.diff(edges)
    means = []
    for array in arrays:
        masked = np.where(use.reshape(-1, *[1] * (array.ndim - 1)), array, 0.0)
        sums = np.add.reduceat(masked, edges[:-1], axis=0)
        means.append(sums[keep] / used[keep].reshape(-1, *[1] * (array.ndim - 1)))
    return means


def _to_powers(model: Model, terms: Terms) -> np.ndarray:
    matrix = np.eye(terms.count)
    matrix[: terms.bias + 1, : terms.bias + 1] = model.basis.to_powers(terms.bias)
    if terms.scale is not None:
        scale = slice(terms.bias + 1, terms.polynomials)
        matrix[scale, scale] = model.basis.to_powers(terms.scale)
    return matrix


def _check_condition(design: np.ndarray, terms: Terms, data: Observations) -> None:
    """Few temperature levels, or a span that the used samples hardly cover, leave the highest coefficients undetermined."""
    norms = np.linalg.norm(design, axis=0)
    enough = len(design) >= 2 * terms.count and np.all(norms > 0)
    if not enough or np.linalg.cond(design / norms) > MAX_CONDITION:
        raise BadInput(
            f"the temperatures (and rates) in the recording cannot tell {terms.count} coefficients apart",
            f"channel {data.channel}",
            "record more temperatures (a sweep, not a few plateaus), or give a smaller --order",
        )


def _check_scale(scale: np.ndarray, half_width: np.ndarray) -> None:
    if not half_width[0] < MIN_SCALE_PRECISION * abs(scale[0]):
        raise BadInput("the true rate moves too little to identify the scale factor", "reference/true_rate",
                       "record faster or longer turns, or choose --channel rate_uncompensated with a recording at rest")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
