"""The evaluation of the paper "Gymnasium dL", reproduced and taken further (`make paper`).

Three tests, each in a module of its own: `safe_lock` (1), `forced` (2), `waypoint` (3). `experiments` runs
them all with five seeds, and writes a table beside that of the paper, and three figures.
"""
