"""Files that users write: the declaration of each kind, and the one loader that reads them and reports what is wrong.

`quantity` and `section` declare tables and entries; `loader` reads a file into them and reports file, line, key, value,
range and the nearest known name. Models of the bench, matrix, car, road and other files of `rig` are in the rooms they
describe; those of device descriptions (register maps, roles, supplies, sensor formats) are here, because drivers and
protocols read no files: they make their values from the plain tables that this room has checked.
"""
