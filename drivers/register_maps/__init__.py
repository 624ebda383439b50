"""Register maps: an actuator controller on Modbus as a file of data, and what its registers and recipes mean.

`map_file` reads a file and says everything that is wrong with it; the rest is what it is made of: quantities in
registers, conditions on them, recipes of commands, blocks to read. `docs/how-to/write-a-register-map.md` is the format
for people, `schema` for editors. No ports, no threads; driven by `drivers.modbus_actuator`.
"""
