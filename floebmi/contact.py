"""Contact laws between floes; a new law is added here and nowhere else.

A contact law is composed of parts, each with a few parameters: elasticity, friction, bonds (in bonds.py), a dashpot,
compressive failure.  A part that is `None` is compiled out, and the arrays that only it needs are not allocated.
"""

import math
from typing import NamedTuple

import numpy as np

from floebmi.bonds import (
    TensileStrength,
    beam_of,
    bending,
    bending_ratio,
    fibre_stress,
    hold,
    tied,
)
from floebmi.errors import InputError
from floebmi.geometry import lens
from floebmi.kept_code import is_ours
from floebmi.kernels import dispatched, has_code, inner
from floebmi.quantities import NonNegative, PoissonRatio, Positive, PositiveFraction

GRAVITY = 9.81  # [m/s²]


class Elastic(NamedTuple):
    """Linear normal elasticity, f_n = E h_min |δ| (eq. normal-elasticity).

    Parameters
    ----------
    youngs_modulus : Young's modulus E [Pa]
    """

    youngs_modulus: Positive = 2.0e7


class Coulomb(NamedTuple):
    """Tangential elasticity with memory of the slip, limited by Coulomb friction (eq. coulomb-friction).

    The lever arms are the actual distances from the centres to the contact point, so that angular momentum
    is conserved for unequal radii too.

    Parameters
    ----------
    coefficient : friction coefficient μ [1]
    poisson_ratio : Poisson's ratio ν [1], which sets k_t/k_n
    spread : standard deviation of μ among the floes, relative to μ [1] (eq. spread); default: the same μ for all
    """

    coefficient: NonNegative = 0.3
    poisson_ratio: PoissonRatio = 0.185
    spread: Positive | None = None


class Damsgaard2018Coulomb(NamedTuple):
    """`Coulomb` friction as in the paper's runs: both lever arms are R_ij, the harmonic mean radius.

    Parameters
    ----------
    coefficient : friction coefficient μ [1]
    poisson_ratio : Poisson's ratio ν [1], which sets k_t/k_n
    spread : standard deviation of μ among the floes, relative to μ [1] (eq. spread); default: the same μ for all
    """

    coefficient: NonNegative = 0.3
    poisson_ratio: PoissonRatio = 0.185
    spread: Positive | None = None


class Restitution(NamedTuple):
    """A dashpot in parallel with the contact spring, given by the coefficient of restitution (eq. dashpot).

    Parameters
    ----------
    coefficient : coefficient of restitution e [1], ratio of rebound to impact speed of two free floes
    """

    coefficient: PositiveFraction


class Dashpot(NamedTuple):
    """`Restitution` in the form that the kernels use: c = 2 ζ √(k_n m_ij), m_ij the reduced mass."""

    damping_ratio: NonNegative


class CompressiveFailure(NamedTuple):
    """Compressive failure of floes that press too hard; one then slides over the other (eqs. compressive-failure, rafting).

    Parameters
    ----------
    toughness : fracture toughness K [Pa m^0.5]; a pair fails at f_n = K h_min^1.5
    coefficient : friction coefficient of one floe sliding over the other [1]
    density_difference : density of water less that of ice [kg/m³]; the buoyancy of the thinner floe presses the two together
    """

    toughness: Positive = 1.285e6
    coefficient: NonNegative = 0.3
    density_difference: Positive = 66.0


class Contact(NamedTuple):
    """A contact law composed of parts; `None` leaves a part out.

    Parameters
    ----------
    elastic : normal elasticity
    friction : friction, which also makes the floes rotate
    bonds : bonds between floes that have touched
    dashpot : normal damping
    failure : compressive failure, followed by sliding of one floe over the other
    """

    elastic: Elastic = Elastic()
    friction: Coulomb | Damsgaard2018Coulomb | None = None
    bonds: TensileStrength | None = None
    dashpot: Restitution | Dashpot | None = None
    failure: CompressiveFailure | None = None


def frictional(
    friction: NonNegative = 0.3,
    youngs_modulus: Positive = 2.0e7,
    poisson_ratio: PoissonRatio = 0.185,
    restitution: PositiveFraction | None = None,
) -> Contact:
    """The paper's frictional model: elasticity, Coulomb friction, rotation; no bonds.

    Parameters
    ----------
    friction : friction coefficient μ [1]
    youngs_modulus : Young's modulus E [Pa]
    poisson_ratio : Poisson's ratio ν [1], which sets k_t/k_n
    restitution : coefficient of restitution e [1], ratio of rebound to impact speed of two free floes; default: no dashpot
    """
    return Contact(
        Elastic(youngs_modulus),
        friction=Coulomb(friction, poisson_ratio),
        dashpot=None if restitution is None else Restitution(restitution),
    )


def cohesive(
    tensile_strength: NonNegative = 200e3,
    youngs_modulus: Positive = 2.0e7,
    restitution: PositiveFraction | None = None,
) -> Contact:
    """The paper's cohesive model: elasticity and bonds; no friction, no rotation.

    Parameters
    ----------
    tensile_strength : tensile strength σ_c [Pa]
    youngs_modulus : Young's modulus E [Pa]
    restitution : coefficient of restitution e [1], ratio of rebound to impact speed of two free floes; default: no dashpot
    """
    return Contact(
        Elastic(youngs_modulus),
        bonds=TensileStrength(tensile_strength),
        dashpot=None if restitution is None else Restitution(restitution),
    )


def prepare(contact: Contact) -> Contact:
    """The law in the form that the kernels use, with the restitution turned into a damping ratio."""
    if isinstance(contact.dashpot, Restitution):
        return contact._replace(dashpot=Dashpot(damping_ratio(contact.dashpot.coefficient)))
    return contact


def check_contact(contact: Contact | None) -> None:
    """Refuse a law without code, bonds whose initial strength exceeds their full strength, and a beam whose Poisson's ratio is not that of friction.

    Raises
    ------
    InputError
    """
    if contact is None:
        return
    if type(contact.elastic) is not Elastic:
        raise InputError(
            f"Contact.elastic = {contact.elastic!r}: must be of the kind Elastic; time step, bonds, walls and energy "
            "ledger assume its linear spring"
        )
    _check_code("Contact", contact)
    if contact.bonds is None:
        return
    strength, healing, beam = (
        contact.bonds.tensile_strength,
        contact.bonds.healing,
        contact.bonds.beam,
    )
    if healing is not None and healing.initial > strength:
        raise InputError(
            f"contact.bonds.healing.initial = {healing.initial!r}: must be at most the tensile_strength, {strength!r}"
        )
    friction = contact.friction
    if beam is not None and friction is not None and beam.poisson_ratio != friction.poisson_ratio:
        raise InputError(
            f"contact.bonds.beam.poisson_ratio = {beam.poisson_ratio!r}: must be that of friction, "
            f"{friction.poisson_ratio!r}"
        )


def _check_code(place: str, law: tuple) -> None:
    """Refuse a user's part for which no code is registered: the code of the law that it replaces would run instead."""
    for name, part in law._asdict().items():
        if hasattr(part, "_asdict"):
            kind = type(part)
            if not (is_ours(kind) or has_code(kind)):
                raise InputError(
                    f"{place}.{name} = {part!r}: no code is registered for a {kind.__name__}"
                )
            _check_code(kind.__name__, part)


def turns(contact: Contact | None) -> bool:
    """Whether the law makes floes rotate, as friction and beams do."""
    return contact is not None and bool(contact.friction or beam_of(contact.bonds))


def own(contact: Contact | None) -> dict[str, tuple[float, float]]:
    """Mean and relative spread of each property that differs from floe to floe, by its name in `Floes`."""
    if contact is None:
        return {}
    friction, bonds = contact.friction, contact.bonds
    found = {}
    if getattr(friction, "spread", None) is not None:
        found["friction"] = friction.coefficient, friction.spread
    if getattr(bonds, "spread", None) is not None:
        found["tensile_strength"] = bonds.tensile_strength, bonds.spread
    return found


def memories(contact: Contact | None) -> tuple[str, ...]:
    """Names of the state that a pair carries from one exchange to the next, as in `pairs.PairList`."""
    if contact is None:
        return ()
    beam, failure = beam_of(contact.bonds), contact.failure
    asked = {
        "slip": contact.friction or beam or failure,
        "bonded": contact.bonds,
        "bent": beam,
        "failed": failure,
        "slid": failure,
    }
    return tuple(name for name, law in asked.items() if law is not None)


def damping_ratio(restitution: float) -> float:
    """Damping ratio ζ for a restitution e, if contact ends where the force vanishes rather than where δ does.

    Schwager & Pöschel (2007), doi:10.1007/s10035-007-0065-z.
    """

    from scipy.optimize import brentq

    def excess(zeta: float) -> float:
        if zeta < 1.0:
            omega = math.sqrt(1.0 - zeta * zeta)
            duration = (math.pi - math.atan2(2 * zeta * omega, omega * omega - zeta * zeta)) / omega
        else:
            omega = math.sqrt(zeta * zeta - 1.0)
            duration = math.log((zeta + omega) / (zeta - omega)) / omega if omega else 2.0
        return math.exp(-zeta * duration) - restitution

    if restitution == 1.0:
        return 0.0
    highest = 1e3
    if excess(highest) > 0:
        raise InputError(
            f"coefficient of restitution = {restitution}: too small; use at least 1e-6"
        )
    return brentq(excess, 0.0, highest, xtol=1e-14)


# ---- the laws in the kernel -------------------------------------------------------------------------
# Geometry of a pair: n points from i to j, t is n turned left by 90°, a gap δ < 0 is an overlap.
#
#        i ──── a_i ────┃──── a_j ──── j        d = |x_j − x_i| = a_i + a_j,  δ = d − (r_i + r_j)
#                  n →  ┃ t ↑
#
# f_n > 0 pushes the floes apart; f_t is the force on i along t; the force on i is −f_n n + f_t t,
# that on j its opposite, and both torques are f_t times the lever arm.


class PairForce(NamedTuple):
    """Force of one pair, its state (slip to slid, see `pairs.PairList`), and the energy [J] that it lost in this step."""

    f_n: float
    f_t: float
    moment: float  # of a beam, on i
    slip: float
    bonded: float
    damped: float  # the dashpot's part of f_n
    bent: float
    failed: float
    slid: float
    blow_n: float  # impulse [N s] at the end of the step, in addition to half a step of f_n and f_t, see `blow`
    blow_t: float
    friction_loss: float
    dashpot_loss: float
    bond_loss: float
    failure_loss: float


@inner
def stiffness(elastic, thickness_i, thickness_j):
    """k_n = E h_min [N/m] (eq. normal-elasticity)."""
    return elastic.youngs_modulus * min(thickness_i, thickness_j)


@dispatched
def stiffness_ratio(friction):
    """k_t/k_n = 2 (1 − ν²)/((2 − ν)(1 + ν)) [1] (eq. tangential-stiffness)."""
    nu = friction.poisson_ratio
    return 2.0 * (1.0 - nu * nu) / ((2.0 - nu) * (1.0 + nu))


@stiffness_ratio.register
def _(friction: None):
    return 0.0


@dispatched
def shear_spring(beam, friction):
    """The part of the law that resists slip: the beam, else friction, else None; beam and friction have the same k_t."""
    return beam


@shear_spring.register
def _(beam: None, friction):
    return friction


@dispatched
def coefficient(friction):
    """μ of all floes [1]; 0 without friction."""
    return friction.coefficient


@coefficient.register
def _(friction: None):
    return 0.0


@dispatched
def coefficient_now(friction, mu, slip_rate):
    """Friction coefficient of a pair at a slip rate [m/s] (0 if no time passes); mu : the coefficient at rest."""
    return mu


@dispatched
def strength(bonds):
    """σ_c of all floes [Pa]; 0 without bonds."""
    return bonds.tensile_strength


@strength.register
def _(bonds: None):
    return 0.0


@dispatched
def lever_arm(friction, radius, other_radius, gap):
    """Distance from a floe's centre to the contact point [m]."""
    return radius + 0.5 * gap


@lever_arm.register
def _(friction: Damsgaard2018Coulomb, radius, other_radius, gap):
    return 2.0 * radius * other_radius / (radius + other_radius)


@dispatched
def tangential(spring, beam, mu, bonded, k_n, pressed, slip, slip_rate, dt):
    """Tangential force on i before and after the step, the slip that is kept, and the energy lost.

    From (eq. coulomb-friction), or from (eq. bond-shear) while a beam holds; pressed : f_n/k_n [m].
    """
    k_t = k_n * stiffness_ratio(spring)
    tried = slip + slip_rate * dt
    limit = mu / stiffness_ratio(spring) * max(pressed, 0.0)
    kept = tied(beam, bonded, tried, min(max(tried, -limit), limit))
    # the force is computed from the slip that is kept, so that recomputing it gives the same bits;
    # the loss is the work of the mean force of the step along the irreversible part of the slip
    return -k_t * slip, -k_t * kept, kept, 0.5 * k_t * (slip + kept) * (tried - kept)


@tangential.register
def _(spring: None, beam, mu, bonded, k_n, pressed, slip, slip_rate, dt):
    return 0.0, 0.0, 0.0, 0.0


@dispatched
def damping(dashpot, k_n, inverse_mass):
    """Dashpot coefficient c [N s/m] of a pair (eq. dashpot); inverse_mass = 1/m_i + 1/m_j.

    It is 0 between two floes with prescribed motion, for which no reduced mass is defined.
    """
    mass = 1.0 / inverse_mass if inverse_mass > 0.0 else 0.0
    return 2.0 * dashpot.damping_ratio * np.sqrt(k_n * mass)


@damping.register
def _(dashpot: None, k_n, inverse_mass):
    return 0.0


@dispatched
def brake(dashpot, k_n, inverse_mass, opening, overlap, touching, bonded):
    """The dashpot's part of f_n, over k_n [m], limited so that only bonded floes pull on each other as they part."""
    part = -damping(dashpot, k_n, inverse_mass) / k_n * opening
    return (part if bonded > 0.0 else max(part, -overlap)) if touching else 0.0


@brake.register
def _(dashpot: None, k_n, inverse_mass, opening, overlap, touching, bonded):
    return 0.0


@dispatched
def braked(dashpot, damped_before, damped, met, opening, part):
    """Impulse [N s] missing from the dashpot in the step in which floes meet, and the energy [J] that it lost.

    Unlike a spring, a dashpot acts with its full force from the first touch on, while the step applies only half of it.
    """
    loss = -0.5 * ((damped if met else damped_before) + damped) * opening * part
    return (0.5 * part * damped if met else 0.0), loss


@braked.register
def _(dashpot: None, damped_before, damped, met, opening, part):
    return 0.0, 0.0


@dispatched
def time_in_contact(friction, gap, opening, dt):
    """The part of a step [s] during which two floes touched, if their gap changed at a constant rate (eq. part-of-a-step); all of it in the paper's friction."""
    since = gap / opening if opening != 0.0 else 0.0  # the gap was zero
    if gap < 0.0:
        return min(since, dt) if opening < 0.0 else dt
    return max(dt - since, 0.0) if opening > 0.0 else 0.0


@time_in_contact.register
def _(friction: Damsgaard2018Coulomb, gap, opening, dt):
    return dt


@dispatched
def fails(failure, failed, gap, k_n, h_min):
    """Whether the ice of a pair has failed before or fails now: f_n > K h_min^1.5 (eq. compressive-failure)."""
    return gap < 0.0 and (failed > 0.0 or -k_n * gap > failure.toughness * h_min * np.sqrt(h_min))


@fails.register
def _(failure: None, failed, gap, k_n, h_min):
    return False


@dispatched
def raft(
    failure, whole, failing, gap, opening, slip_rate, r_i, r_j, h_min, k_n, k_t, slip, bonded,
    failed, slid, damped_before, dt,
):  # fmt: skip
    """The force after the ice has failed: Coulomb friction between the floes over the lens where they overlap (eq. rafting).

    The spring (slid, slip) along n and t is as stiff as the contact, and its force is limited by friction; at failure it
    starts from the overlap at that time.  The loss is the work of the forces before and after along the
    displacement, less the energy that stays stored.  `whole` is the force of a pair that has not failed.
    """
    was_failed = failed > 0.0
    if not (failing or was_failed):
        return whole
    press = failure.density_difference * GRAVITY * h_min * lens(r_i, r_j, r_i + r_j + gap)
    limit = failure.coefficient * press / k_n
    way_n, way_t = opening * dt, slip_rate * dt
    tried_n, tried_t = slid + way_n if was_failed else gap, slip + way_t
    size = np.sqrt(tried_n * tried_n + tried_t * tried_t)
    share = limit / size if size > limit else 1.0
    kept_n, kept_t = share * tried_n, share * tried_t
    k_before = k_n if was_failed else k_t
    before = gap - way_n if gap < way_n or bonded > 0.0 else 0.0
    before = slid if was_failed else before
    taken = 0.5 * k_n * (before + kept_n) * way_n + 0.5 * (k_before * slip + k_n * kept_t) * way_t
    freed = k_n * before * before + k_before * slip * slip
    loss = taken + 0.5 * (freed - k_n * (kept_n * kept_n + kept_t * kept_t))
    return PairForce(
        -k_n * kept_n, -k_n * kept_t, 0.0,
        kept_t, 0.0, 0.0, 0.0, 1.0 if failing else 0.0, kept_n,
        0.0, 0.0,
        loss if was_failed else 0.0, -0.5 * damped_before * way_n, whole.bond_loss,
        0.0 if was_failed else loss,
    )  # fmt: skip


@raft.register
def _(
    failure: None, whole, failing, gap, opening, slip_rate, r_i, r_j, h_min, k_n, k_t, slip, bonded,
    failed, slid, damped_before, dt,
):  # fmt: skip
    return whole


@inner
def pair_force(
    law, gap, opening, slip_rate, turn_rate, r_i, r_j, h_i, h_j, inverse_mass, mu, sigma,
    slip, bonded, damped_before, bent, failed, slid, dt,
):  # fmt: skip
    """The contact law: force from gap δ [m] and its rate, slip rate [m/s], ω_j − ω_i, and the pair's state.

    The force before a step acts for its first half and the force after it for its second half.  Where floes
    touched for only part of the step, the blow takes back the excess of that one force; a bond that breaks
    acts in the first half of the step (eq. broken-bond).  Losses are the work of the same forces.
    """
    k_n = stiffness(law.elastic, h_i, h_j)
    mu = coefficient_now(law.friction, mu, slip_rate if dt > 0.0 else 0.0)
    mean_radius = 2.0 * r_i * r_j / (r_i + r_j)
    beam = beam_of(law.bonds)
    spring = shear_spring(beam, law.friction)
    k_t, k_b = k_n * stiffness_ratio(spring), k_n * bending_ratio(beam) * mean_radius**2
    failing = fails(law.failure, failed, gap, k_n, min(h_i, h_j))
    was_bonded = bonded > 0.0
    modulus = law.elastic.youngs_modulus
    shear = modulus * stiffness_ratio(beam) * abs(slip + slip_rate * dt) / mean_radius
    fibre = fibre_stress(beam, modulus, bent + turn_rate * dt)
    held = hold(law.bonds, sigma, modulus, mean_radius, gap, shear, fibre, bonded, dt)
    now_bonded = 0.0 if failing else held
    touching = gap < 0.0 or now_bonded > 0.0
    overlap = -gap if touching else 0.0
    braking = brake(law.dashpot, k_n, inverse_mass, opening, overlap, touching, now_bonded)
    pressed = overlap + braking
    f_n, damped = k_n * pressed, k_n * braking
    breaks, gap_before = was_bonded and not touching, gap - opening * dt
    # a bond that breaks in a step that began with an overlap acted as a mere contact
    undivided = was_bonded and not (breaks and gap_before < 0.0)
    part = dt if undivided else time_in_contact(law.friction, gap, opening, dt)
    f_t_before, f_t, kept, slip_loss = tangential(
        spring, beam, mu, now_bonded, k_n, pressed, slip, slip_rate, part
    )
    moment, kept_bent, bend_loss = bending(beam, now_bonded, k_b, bent, turn_rate, dt)
    both_before = damped_before - k_n * gap_before
    f_n_before = both_before if was_bonded else max(both_before, 0.0)
    absent = 0.5 * (dt - part)
    blow_n = -absent * (f_n if touching else f_n_before)
    blow_t = -absent * (f_t if touching else f_t_before)
    met = touching and damped_before == 0.0  # not by `part`: floes may meet as the step before ends
    dashpot_blow, dashpot_loss = braked(law.dashpot, damped_before, damped, met, opening, part)
    blow_n += dashpot_blow
    snap_loss = 0.0 if failing else tied(beam, bonded, slip_loss, 0.0)
    friction_loss = slip_loss - snap_loss
    bond_loss = (0.5 * k_n * max(gap_before, 0.0) * gap if breaks else 0.0) + bend_loss + snap_loss
    whole = PairForce(
        f_n, f_t, moment, kept, now_bonded, damped, kept_bent, 0.0, 0.0, blow_n, blow_t,
        friction_loss, dashpot_loss, bond_loss, 0.0,
    )  # fmt: skip
    return raft(
        law.failure, whole, failing, gap, opening, slip_rate, r_i, r_j, min(h_i, h_j), k_n, k_t,
        slip, bonded, failed, slid, damped_before, dt,
    )  # fmt: skip


@dispatched
def blow(dashpot, impulse, rate, ahead, inverse_mass):
    """The impulse that does the work impulse × rate [J] on two floes (eq. part-of-a-step), and the work not done [J].

    ahead : the rate at which they would part or slip at the end of the step [m/s].  If their kinetic energy is less
    than the work to be taken, they stop, and the remainder is the work not done.
    """
    return impulse, 0.0  # a dashpot is of first order as well


@blow.register
def _(dashpot: None, impulse, rate, ahead, inverse_mass):
    if impulse == 0.0 or inverse_mass == 0.0:
        return impulse, 0.0
    left = ahead * ahead + 2.0 * inverse_mass * impulse * rate
    found = (math.copysign(np.sqrt(max(left, 0.0)), rate) - ahead) / inverse_mass
    return found, max(-left, 0.0) / (2.0 * inverse_mass)


@inner
def stored(law, f, gap, r_i, r_j, h_i, h_j):
    """Elastic energy [J] of a pair with the force f; without losses the force is minus its gradient."""
    k_n = stiffness(law.elastic, h_i, h_j)
    beam = beam_of(law.bonds)
    k_t = k_n * stiffness_ratio(shear_spring(beam, law.friction))
    k_b = k_n * bending_ratio(beam) * (2.0 * r_i * r_j / (r_i + r_j)) ** 2
    if f.failed > 0.0:
        return 0.5 * k_n * (f.slid * f.slid + f.slip * f.slip)
    return 0.5 * (k_n * gap * gap + k_t * f.slip * f.slip + k_b * f.bent * f.bent)


@dispatched
def sliding_ratio(failure):
    """Tangential stiffness of floes that slide over each other after failure, over k_n [1]."""
    return 1.0


@sliding_ratio.register
def _(failure: None):
    return 0.0


@inner
def largest_ratio(law):
    """The largest k_t/k_n that a pair may have [1]."""
    spring = shear_spring(beam_of(law.bonds), law.friction)
    return max(stiffness_ratio(spring), sliding_ratio(law.failure))
