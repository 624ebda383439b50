"""Files that users write: how each kind is declared, and the one loader that reads them and reports what is wrong.

`quantity` and `section` declare tables and entries; `loader` reads a file into them and names file, line, key, value,
range and the nearest known name. Models of the bench, matrix, car, road and other files of `rig` lie with what they
describe; those of device descriptions (register maps, roles, supplies, sensor formats) lie here, since drivers and
protocols read no file: they make their values from the plain tables that this room has checked.
"""
