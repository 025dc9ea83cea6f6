"""Mechanisms as data, in the plane and in space.

- `models`, `spatial_model`, `joints`, `laws`: what a file may say;
- `builder`, `planar`, `spatial`: how its parts become rows, forces and masses; `element_tables`
  lays these out, and `elements` evaluates them in one compiled loop over sums s = A u + a, with
  laws of time from `timed` and `sines`; `rates`: their derivatives by time, and energy;
- `positions`, `start`: on the constraints, no redundant row, velocities that fit; `guess`: how far
  assembling moved a position;
- `loading`, `registry`, `families`, `spec`: from a file, a name, a size or a config to a problem;
- `known`, `spatial_outputs`, `spatial_summary`: exact solutions, outputs, and facts for `validate`.
"""
