"""Flat walls: what they are, and where a robot sees or knows some.

They are found in the disparities of a head (`stereo`), in laser scans (`laser`) and in the ranges
of sonars (`sonar`), except where people (`people_in_view`) and team-mates are; `known` has those of
a file or a map. `fit` fits lines to points; `ranges` is what laser scanners and sonars measure.
"""

from mrs_people_loc.localization.walls.walls import NOBODY, SeenWalls, Walls, moved

__all__ = ["NOBODY", "SeenWalls", "Walls", "moved"]
