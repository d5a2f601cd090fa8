"""
Floe-size distribution
======================

Radii between 100 m and 2 km drawn from a power law with the exponent −1.8 of Damsgaard, Adcroft & Sergienko (2018), and
laid out without overlap. Number of floes per bin of radius, and what the law says.
"""

import numpy as np

import floebmi as fb
from floebmi.plot import graph

least, most, exponent = 100.0, 2000.0, -1.8
domain = fb.Domain((0, 60e3), (0, 60e3), "periodic", "periodic", "periodic", "periodic")
floes = fb.scatter(domain, fb.PowerLaw(least, most, exponent), concentration=0.6, seed=1)

edges = np.geomspace(least, most, 16)
density = np.histogram(floes.radius, edges)[0] / np.diff(edges)
middle = np.sqrt(edges[1:] * edges[:-1])
q = exponent + 1
law = len(floes) * q / (most**q - least**q) * edges**exponent
with graph(6, 4) as figure:
    axes = figure.subplots()
    axes.loglog(edges, law, label="n ∝ r$^{-1.8}$")
    axes.loglog(middle, density, "o", label=f"{len(floes)} floes")
    axes.set(xlabel="radius [m]", ylabel="floes per radius [m⁻¹]")
    axes.legend()
measured = float(np.polyfit(np.log(middle), np.log(density), 1)[0])  # slope
print(f"slope of the points: {measured:.2f}")
