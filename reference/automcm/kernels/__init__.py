"""Trajectory kernels: pure functions on numpy arrays, in SI units (docs/kernels.md).

Times are seconds, places metres (x forward, y left), speeds m/s, angles radians.  The messages
carry integers (automcm_spec.vocabulary.messages.Trajectory); ``from_message`` and ``to_message``
convert.

| module | kernel |
|---|---|
| trajectory | the Trajectory type |
| convert | KIN-1, a path with speeds as positions over time |
| thin | KIN-2, a reduction of the points to one frame, within a bound |
| collide | KIN-3, the closest approach of two, also between samples |
| extents | KIN-3 for vehicles with a length and a width, as discs |
| discover | KIN-4, the target vehicle |
| prescribe | KIN-5, the prescribed trajectory |
| verify | KIN-6, the safety check of a prescription |

The applications import it; it imports messages and ``encoding``.
"""
