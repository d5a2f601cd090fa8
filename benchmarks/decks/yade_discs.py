"""The same in YADE, whose spheres get a disc's mass and inertia and keep to the plane.

Arguments: file of discs (npz), skin, step, steps to warm up, steps to time.
"""

import json
import math
import sys
import time

import numpy as np
from yade import *  # noqa: F403  (YADE's own names are made so)

# ruff: noqa: F405
discs = np.load(sys.argv[1])
skin, dt, warm, steps = float(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5])
depth = 8 * float(discs["radius"].max())
O.periodic = True
O.cell.setBox(float(discs["side"]), float(discs["side"]), depth)
material = O.materials.append(
    FrictMat(density=934, young=1, poisson=1, frictionAngle=math.atan(0.3))
)
columns = (discs[name].tolist() for name in ("x", "y", "radius", "u", "v"))
for x, y, r, u, v in zip(*columns, strict=True):
    body = sphere((x, y, 0.5 * depth), r, material=material)
    body.state.mass = 934 * math.pi * r**2
    body.state.inertia = (0.5 * body.state.mass * r**2,) * 3
    body.state.vel = (u, v, 0)
    body.state.blockedDOFs = "zXY"
    O.bodies.append(body)
collider = InsertionSortCollider([Bo1_Sphere_Aabb()], verletDist=0.5 * skin)
spring = Ip2_FrictMat_FrictMat_FrictPhys(
    kn=MatchMaker(algo="val", val=2e7), ks=MatchMaker(algo="val", val=17961432.5)
)
law = Law2_ScGeom_FrictPhys_CundallStrack()
O.engines = [
    ForceResetter(),
    collider,
    InteractionLoop([Ig2_Sphere_Sphere_ScGeom()], [spring], [law]),
    NewtonIntegrator(damping=0),
]
O.dt = dt
O.timingEnabled = True


def look():
    states = [body.state for body in O.bodies]
    touching = sum(1 for i in O.interactions if i.isReal and i.geom.penetrationDepth > 0)
    return {
        "energy": sum(0.5 * s.mass * s.vel.squaredNorm() for s in states),
        "spin": sum(0.5 * s.inertia[2] * s.angVel[2] ** 2 for s in states),
        "contacts": 2 * touching / len(states),
    }


O.run(warm, True)
first, before, rebuilds = look(), collider.execTime, collider.numAction
start = time.perf_counter()
O.run(steps, True)
seconds = time.perf_counter() - start
rebuild = 1e-9 * (collider.execTime - before)
result = {"seconds": seconds, "rebuild": rebuild, "rebuilds": collider.numAction - rebuilds}
print(json.dumps(result | {"first": first, "last": look()}))
print(next(line for line in open("/proc/self/status") if line.startswith("VmHWM")))
