"""The momentum equation, and the step that advances it.

    m du/dt = Σ contacts (f_n + f_t) + Σ forces that the scene lists          (eq. momentum)
    J dω/dt = Σ contacts torque      + Σ torques of the fluids                (eq. angular-momentum)

A step of the default scheme is kick, drift, touch, kick: half a velocity step under the contact forces,
half a way, the other forces (forces.py, one linearly implicit step), the other half of the way, the contact
forces at the new place, and the second half kick.  It is symmetric, of second order, and keeps the energy of
an undamped pack.  `taylor2` and `taylor3` are the paper's schemes (Eq. 4 and its text).

Kernels work on packed floes: active ones only, sorted in space, what a contact reads of a floe in one line
of the cache.  Which fields exist, and which arrays, follows from the laws: see `pack.py`.
"""

from typing import Literal, NamedTuple

import numpy as np

from floebmi.contact import lever_arm, pair_force
from floebmi.forces import book, book_spin, total_acceleration, total_spin_up
from floebmi.kernels import dispatched, jit
from floebmi.quantities import Positive, PositiveFraction

BLOCK = (
    64  # pairs computed at a time: the buffers stay in the nearest cache, and the middle vectorises
)
# Rows of the buffer.  Results lie below what they are computed from: only so can the compiler see that
# no later pair reads what an earlier one wrote.
FX, FY, TORQUE_I, TORQUE_J = (row * BLOCK for row in range(4))
DX, DY, R_I, R_J, H_I, H_J, DU, DV, W, OMEGA_I, OMEGA_J = (row * BLOCK for row in range(4, 15))
BUFFER = 15 * BLOCK


class Step(NamedTuple):
    """How time is stepped.

    Parameters
    ----------
    scheme : "verlet" (default), or the paper's "taylor2", "taylor3"
    fraction : of the stability limit 2/ω_max, ω_max from the floes' own stiffness sums (eq. stable-step)
    epsilon : if given, the paper's rule instead: Δt = ε √(m_min/k_max) (Eq. 4; the paper's ε is 0.07)
    length : if given, a fixed step [s] instead
    """

    scheme: Literal["verlet", "taylor2", "taylor3"] = "verlet"
    fraction: PositiveFraction = 0.15
    epsilon: Positive | None = None
    length: Positive | None = None


WALL = np.dtype(
    [
        ("axis", np.int64),  # 0: the wall stands across x, 1: across y
        ("side", np.float64),  # +1: the ice is on the side of larger coordinates
        ("position", np.float64),
        ("speed", np.float64),
        ("inverse_mass", np.float64),
        ("press", np.float64),  # force that the wall is loaded with, towards the ice [N]
        ("damping", np.float64),  # rate [1/s]
        ("force", np.float64),  # of the ice on the wall, along the axis [N]
        ("impulse", np.float64),  # given to the ice, along the axis [N s]
        ("work", np.float64),  # done on the ice [J]
    ]
)


class Losses(NamedTuple):
    """Energy lost in contacts [J] and bonds broken."""

    friction: float
    dashpot: float
    bonds: float
    broken: float


@dispatched
def wrap(period, d):
    """The nearest image of a distance in a periodic direction."""
    return d - period * np.rint(d / period)


@wrap.register
def _(period: None, d):
    return d


@dispatched
def recall(memory, p):
    """What pair p remembers; nothing where nothing is remembered."""
    return memory[
        np.uintp(p)
    ]  # unsigned: no wrap-around of negative indices, so the loop vectorises


@recall.register
def _(memory: None, p):
    return 0.0


@dispatched
def remember(memory, p, value):
    """Keep a value in the slot of pair p."""
    memory[np.uintp(p)] = value


@remember.register
def _(memory: None, p, value):
    pass


# ---- kick, drift, touch -----------------------------------------------------------------------------


@jit
def kick(moving, spinning, force, inverse_x, inverse_y, inverse_spin, held, walls, dt, constraint):
    """Contact forces change the velocities for a time dt; held floes and walls are booked."""
    for k in range(inverse_x.size):
        moving[k].u += dt * inverse_x[k] * force[k].x
        moving[k].v += dt * inverse_y[k] * force[k].y
    kick_spin(spinning, force, inverse_spin, dt)
    for q in range(held.size):
        k = held[q]
        x = 0.0 if inverse_x[k] > 0.0 else -dt * force[k].x
        y = 0.0 if inverse_y[k] > 0.0 else -dt * force[k].y
        constraint[0] += x
        constraint[1] += y
        constraint[2] += x * moving[k].u + y * moving[k].v
        constraint[2] += held_spin_work(spinning, force, inverse_spin, k, dt)
    kick_walls(walls, dt)


@dispatched
def kick_spin(spinning, force, inverse_spin, dt):
    for k in range(inverse_spin.size):
        spinning[k].omega += dt * inverse_spin[k] * force[k].torque


@kick_spin.register
def _(spinning: None, force, inverse_spin, dt):
    pass


@dispatched
def kick_walls(walls, dt):
    for w in range(walls.size):
        wall = walls[w]
        change = dt * wall.inverse_mass * (wall.force + wall.side * wall.press)
        wall.impulse -= dt * wall.force
        wall.work -= dt * wall.force * (wall.speed + 0.5 * change)
        wall.speed += change


@kick_walls.register
def _(walls: None, dt):
    pass


@dispatched
def held_spin_work(spinning, force, inverse_spin, k, dt):
    if inverse_spin[k] > 0.0:
        return 0.0
    return -dt * force[k].torque * spinning[k].omega


@held_spin_work.register
def _(spinning: None, force, inverse_spin, k, dt):
    return 0.0


@jit
def drift(
    forces, at, place, moving, spinning, angle, mass, inertia,
    inverse_x, inverse_y, inverse_spin, walls, dt, substeps, constraint,
):  # fmt: skip
    """Half the way, the other forces, half the way; returns the largest speed² [m²/s²]."""
    fastest = 0.0
    half = 0.5 * dt
    h = dt / substeps
    for k in range(place.size):
        floe = place[k]
        motion = moving[k]
        u, v = motion.u, motion.v
        floe.x += half * u
        floe.y += half * v
        for _ in range(substeps):
            u, v = push(
                forces, at, k, u, v, mass[k], inverse_x[k] > 0.0, inverse_y[k] > 0.0, h, constraint
            )
        motion.u, motion.v = u, v
        floe.x += half * u
        floe.y += half * v
        fastest = max(fastest, u * u + v * v)
    drift_spin(spinning, forces, at, angle, inertia, inverse_spin, dt, substeps, constraint)
    return max(fastest, drift_walls(walls, dt))


@dispatched
def drift_walls(walls, dt):
    fastest = 0.0
    for w in range(walls.size):
        wall = walls[w]
        wall.position += 0.5 * dt * wall.speed
        wall.speed *= np.exp(-wall.damping * dt)
        wall.position += 0.5 * dt * wall.speed
        fastest = max(fastest, wall.speed * wall.speed)
    return fastest


@drift_walls.register
def _(walls: None, dt):
    return 0.0


@jit
def push(forces, at, k, u, v, mass, free_x, free_y, h, constraint):
    """The other forces: (1 − h/2 Σ J) δu = h Σ a, a held axis keeps its velocity."""
    a = total_acceleration(forces, at, k, u, v)
    ax, xx, xy = (a.x, a.xx, a.xy) if free_x else (0.0, 0.0, 0.0)
    ay, yx, yy = (a.y, a.yx, a.yy) if free_y else (0.0, 0.0, 0.0)
    half = 0.5 * h
    m11, m12, m21, m22 = 1.0 - half * xx, -half * xy, -half * yx, 1.0 - half * yy
    scale = h / (m11 * m22 - m12 * m21)
    du = scale * (m22 * ax - m12 * ay)
    dv = scale * (m11 * ay - m21 * ax)
    book(forces, at, k, u, v, du, dv, mass * h)
    if not free_x:
        x = -mass * h * (a.x + 0.5 * (a.xx * du + a.xy * dv))
        constraint[0] += x
        constraint[2] += x * u
    if not free_y:
        y = -mass * h * (a.y + 0.5 * (a.yx * du + a.yy * dv))
        constraint[1] += y
        constraint[2] += y * v
    return u + du, v + dv


@dispatched
def drift_spin(spinning, forces, at, angle, inertia, inverse_spin, dt, substeps, constraint):
    half = 0.5 * dt
    h = dt / substeps
    for k in range(angle.size):
        omega = spinning[k].omega
        angle[k] += half * omega
        for _ in range(substeps):
            alpha, slope = total_spin_up(forces, at, k, omega)
            free = inverse_spin[k] > 0.0
            change = h * alpha / (1.0 - 0.5 * h * slope) if free else 0.0
            book_spin(forces, at, k, omega, change, inertia[k] * h)
            if not free:
                constraint[2] -= inertia[k] * h * alpha * omega
            omega += change
        spinning[k].omega = omega
        angle[k] += half * omega


@drift_spin.register
def _(spinning: None, forces, at, angle, inertia, inverse_spin, dt, substeps, constraint):
    pass


@jit
def touch(
    law, wall_law, period_x, period_y, place, moving, spinning, pair_i, pair_j, slip, bonded,
    damped, walls, wall_floe, wall_number, wall_damped, dt, force, buffer,
):  # fmt: skip
    """Contact forces at the present place; `dt` is the time over which contacts have slipped."""
    for k in range(force.size):
        force[k].x = 0.0
        force[k].y = 0.0
    clear_torque(spinning, force)
    losses = touch_floes(
        law, period_x, period_y, place, moving, spinning,
        pair_i, pair_j, slip, bonded, damped, dt, force, buffer,
    )  # fmt: skip
    wall_loss = touch_walls(
        wall_law, place, moving, walls, wall_floe, wall_number, wall_damped, dt, force
    )
    return Losses(losses.friction, losses.dashpot + wall_loss, losses.bonds, losses.broken)


@dispatched
def clear_torque(spinning, force):
    for k in range(force.size):
        force[k].torque = 0.0


@clear_torque.register
def _(spinning: None, force):
    pass


@dispatched
def touch_floes(
    law, period_x, period_y, place, moving, spinning, pair_i, pair_j, slip, bonded, damped, dt,
    force, buffer,
):  # fmt: skip
    friction_loss, dashpot_loss, bond_loss, broken = 0.0, 0.0, 0.0, 0.0
    for first in range(0, pair_i.size, BLOCK):
        n = min(BLOCK, pair_i.size - first)
        for k in range(n):
            i, j = pair_i[first + k], pair_j[first + k]
            one, other = place[i], place[j]
            buffer[DX + k] = other.x - one.x
            buffer[DY + k] = other.y - one.y
            buffer[R_I + k] = one.r
            buffer[R_J + k] = other.r
            buffer[H_I + k] = one.h
            buffer[H_J + k] = other.h
            gather_motion(moving, i, j, k, buffer)
            gather_spin(spinning, i, j, k, buffer)
        for k in range(n):
            dx, dy = wrap(period_x, buffer[DX + k]), wrap(period_y, buffer[DY + k])
            r_i, r_j = buffer[R_I + k], buffer[R_J + k]
            distance = np.sqrt(dx * dx + dy * dy)
            over = 1.0 / distance
            nx, ny = dx * over, dy * over
            gap = distance - (r_i + r_j)
            a_i = lever_arm(law.friction, r_i, r_j, gap)
            a_j = lever_arm(law.friction, r_j, r_i, gap)
            du, dv, inverse_mass = relative_motion(moving, k, buffer)
            opening = du * nx + dv * ny
            slip_rate = du * ny - dv * nx + turning(spinning, a_i, a_j, k, buffer)
            was_bonded = recall(bonded, first + k)
            f = pair_force(
                law, gap, opening, slip_rate, r_i, r_j,
                buffer[H_I + k], buffer[H_J + k], inverse_mass,
                recall(slip, first + k), was_bonded, recall(damped, first + k), dt,
            )  # fmt: skip
            remember(damped, first + k, f.damped)
            remember(slip, first + k, f.slip)
            remember(bonded, first + k, f.bonded)
            friction_loss += f.friction_loss
            dashpot_loss += f.dashpot_loss
            bond_loss += f.bond_loss
            broken += max(was_bonded - f.bonded, 0.0)
            buffer[FX + k] = -f.f_n * nx - f.f_t * ny
            buffer[FY + k] = -f.f_n * ny + f.f_t * nx
            buffer[TORQUE_I + k] = f.f_t * a_i
            buffer[TORQUE_J + k] = f.f_t * a_j
        for k in range(n):
            i, j = pair_i[first + k], pair_j[first + k]
            force[i].x += buffer[FX + k]
            force[i].y += buffer[FY + k]
            force[j].x -= buffer[FX + k]
            force[j].y -= buffer[FY + k]
            scatter_torque(spinning, i, j, k, buffer, force)
    return Losses(friction_loss, dashpot_loss, bond_loss, broken)


@touch_floes.register
def _(
    law: None, period_x, period_y, place, moving, spinning, pair_i, pair_j, slip, bonded, damped,
    dt, force, buffer,
):  # fmt: skip
    return Losses(0.0, 0.0, 0.0, 0.0)


@dispatched
def gather_motion(moving, i, j, k, buffer):
    one, other = moving[i], moving[j]
    buffer[DU + k] = other.u - one.u
    buffer[DV + k] = other.v - one.v
    buffer[W + k] = one.w + other.w


@gather_motion.register
def _(moving: None, i, j, k, buffer):
    pass


@dispatched
def relative_motion(moving, k, buffer):
    """Velocity of j relative to i [m/s], and 1/m_i + 1/m_j."""
    return buffer[DU + k], buffer[DV + k], buffer[W + k]


@relative_motion.register
def _(moving: None, k, buffer):
    return 0.0, 0.0, 1.0


@dispatched
def gather_spin(spinning, i, j, k, buffer):
    buffer[OMEGA_I + k] = spinning[i].omega
    buffer[OMEGA_J + k] = spinning[j].omega


@gather_spin.register
def _(spinning: None, i, j, k, buffer):
    pass


@dispatched
def turning(spinning, a_i, a_j, k, buffer):
    """Part of the slip rate that comes from rotation [m/s]."""
    return a_i * buffer[OMEGA_I + k] + a_j * buffer[OMEGA_J + k]


@turning.register
def _(spinning: None, a_i, a_j, k, buffer):
    return 0.0


@dispatched
def scatter_torque(spinning, i, j, k, buffer, force):
    force[i].torque += buffer[TORQUE_I + k]
    force[j].torque += buffer[TORQUE_J + k]


@scatter_torque.register
def _(spinning: None, i, j, k, buffer, force):
    pass


@dispatched
def touch_walls(wall_law, place, moving, walls, wall_floe, wall_number, wall_damped, dt, force):
    """Frictionless walls push floes that reach over them (eq. wall); returns the energy lost [J]."""
    loss = 0.0
    for w in range(walls.size):
        walls[w].force = 0.0
    for q in range(wall_floe.size):
        k = wall_floe[q]
        wall = walls[wall_number[q]]
        floe = place[k]
        across = floe.x if wall.axis == 0 else floe.y
        gap = wall.side * (across - wall.position) - floe.r
        opening, inverse_mass = wall_opening(moving, k, wall.axis, wall.side, wall.speed)
        f = pair_force(
            wall_law, gap, opening, 0.0, floe.r, floe.r, floe.h, floe.h,
            inverse_mass, 0.0, 0.0, recall(wall_damped, q), dt,
        )  # fmt: skip
        remember(wall_damped, q, f.damped)
        if wall.axis == 0:
            force[k].x += wall.side * f.f_n
        else:
            force[k].y += wall.side * f.f_n
        wall.force -= wall.side * f.f_n
        loss += f.dashpot_loss
    return loss


@touch_walls.register
def _(wall_law: None, place, moving, walls, wall_floe, wall_number, wall_damped, dt, force):
    return 0.0


@dispatched
def wall_opening(moving, k, axis, side, speed):
    across = moving[k].u if axis == 0 else moving[k].v
    return side * (across - speed), moving[k].w


@wall_opening.register
def _(moving: None, k, axis, side, speed):
    return 0.0, 1.0


# ---- the schemes ------------------------------------------------------------------------------------


@jit
def verlet(
    law, wall_law, forces, at, period_x, period_y, packed, pairs, walls, wall_floe, wall_number,
    wall_damped, constraint, losses, dt, steps, substeps, travelled, half_skin,
):  # fmt: skip
    """Up to `steps` steps of dt; ends early when the list may be stale. Returns steps done, way."""
    p = packed
    buffer = np.empty(BUFFER)
    done = 0
    while done < steps and travelled < half_skin:
        kick(p.motion, p.spinning, p.force, p.inverse_x, p.inverse_y, p.inverse_spin, p.held,
             walls, 0.5 * dt, constraint)  # fmt: skip
        fastest = drift(
            forces, at, p.place, p.motion, p.spinning, p.angle, p.mass, p.inertia,
            p.inverse_x, p.inverse_y, p.inverse_spin, walls, dt, substeps, constraint,
        )  # fmt: skip
        lost = touch(
            law, wall_law, period_x, period_y, p.place, p.moving, p.spinning,
            pairs.i, pairs.j, pairs.slip, pairs.bonded, pairs.damped, walls, wall_floe,
            wall_number, wall_damped, dt, p.force, buffer,
        )  # fmt: skip
        kick(p.motion, p.spinning, p.force, p.inverse_x, p.inverse_y, p.inverse_spin, p.held,
             walls, 0.5 * dt, constraint)  # fmt: skip
        book_losses(losses, lost)
        travelled += dt * np.sqrt(fastest)
        done += 1
    return done, travelled


@jit
def taylor(
    third_order, law, wall_law, forces, at, period_x, period_y, packed, pairs, walls, wall_floe,
    wall_number, wall_damped, constraint, losses, dt, steps, travelled, half_skin,
):  # fmt: skip
    """The paper's schemes: forces at the old place and velocity, then one Taylor step.

    x += u Δt + ½ a Δt² (+ ⅙ (a − a_old) Δt²),  u += a Δt (+ ½ (a − a_old) Δt)   (eq. taylor)

    a_old belongs to the contact forces; the other forces are explicit, their impulse is a Δt.
    """
    p = packed
    buffer = np.empty(BUFFER)
    done = 0
    while done < steps and travelled < half_skin:
        lost = touch(
            law, wall_law, period_x, period_y, p.place, p.moving, p.spinning,
            pairs.i, pairs.j, pairs.slip, pairs.bonded, pairs.damped, walls, wall_floe,
            wall_number, wall_damped, dt, p.force, buffer,
        )  # fmt: skip
        book_losses(losses, lost)
        fastest = 0.0
        for k in range(p.place.size):
            floe, motion = p.place[k], p.motion[k]
            other = total_acceleration(forces, at, k, motion.u, motion.v)
            ax, ay = p.inverse_x[k] * p.force[k].x, p.inverse_y[k] * p.force[k].y
            ox = other.x if p.inverse_x[k] > 0.0 else 0.0
            oy = other.y if p.inverse_y[k] > 0.0 else 0.0
            jerk_x = (ax - p.previous[k, 0]) if third_order else 0.0
            jerk_y = (ay - p.previous[k, 1]) if third_order else 0.0
            du = (ax + ox + 0.5 * jerk_x) * dt
            dv = (ay + oy + 0.5 * jerk_y) * dt
            book(forces, at, k, motion.u, motion.v, 0.0, 0.0, p.mass[k] * dt)
            floe.x += (motion.u + (0.5 * (ax + ox) + jerk_x / 6.0) * dt) * dt
            floe.y += (motion.v + (0.5 * (ay + oy) + jerk_y / 6.0) * dt) * dt
            motion.u += du
            motion.v += dv
            p.previous[k, 0], p.previous[k, 1] = ax, ay
            fastest = max(fastest, motion.u**2 + motion.v**2)
        for q in range(p.held.size):
            k = p.held[q]
            other = total_acceleration(forces, at, k, p.motion[k].u, p.motion[k].v)
            if p.inverse_x[k] == 0.0:
                x = -dt * (p.force[k].x + p.mass[k] * other.x)
                constraint[0] += x
                constraint[2] += x * p.motion[k].u
            if p.inverse_y[k] == 0.0:
                y = -dt * (p.force[k].y + p.mass[k] * other.y)
                constraint[1] += y
                constraint[2] += y * p.motion[k].v
        taylor_spin(p.spinning, third_order, forces, at, p, dt)
        kick_walls(walls, dt)
        fastest = max(fastest, drift_walls(walls, dt))
        travelled += dt * np.sqrt(fastest)
        done += 1
    return done, travelled


@dispatched
def taylor_spin(spinning, third_order, forces, at, p, dt):
    for k in range(p.angle.size):
        omega = spinning[k].omega
        other = total_spin_up(forces, at, k, omega)[0] if p.inverse_spin[k] > 0.0 else 0.0
        alpha = p.inverse_spin[k] * p.force[k].torque
        jerk = (alpha - p.previous[k, 2]) if third_order else 0.0
        book_spin(forces, at, k, omega, 0.0, p.inertia[k] * dt)
        p.angle[k] += (omega + (0.5 * (alpha + other) + jerk / 6.0) * dt) * dt
        spinning[k].omega += (alpha + other + 0.5 * jerk) * dt
        p.previous[k, 2] = alpha


@taylor_spin.register
def _(spinning: None, third_order, forces, at, p, dt):
    pass


@jit
def book_losses(losses, lost):
    losses[0] += lost.friction
    losses[1] += lost.dashpot
    losses[2] += lost.bonds
    losses[3] += lost.broken
