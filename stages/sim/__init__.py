"""The simulated world. Importing it chooses the OpenGL backend, which MuJoCo reads when it is imported."""

from stages.sim.gl import choose_backend

choose_backend()
