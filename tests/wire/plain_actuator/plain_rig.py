"""The simulated rig behind an actuator that only follows set-points: `plain_rig.py BENCH`."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path

from simulators.bench import Addresses
from simulators.options import RigOptions
from simulators.plant import records
from simulators.rig import RunOptions, SimulatedRig

LONGEST_S = 0.05
"""So long the rod goes on at the last velocity; then it stands."""


class PlainServer:
    """Speaks the plain actuator's lines; moves the plant by its set-point."""

    def __init__(self, rig: SimulatedRig) -> None:
        self.rig = rig
        self.setpoint = (0.0, 0.0)
        self.since_s = 0.0
        rig.every_tick.append(self.follow)

    def follow(self) -> None:
        """Put the set-point of this moment into the servo loop."""
        plant = self.rig.plant
        if int(plant.command["pressure"][0]) == 2:
            position_m, velocity_m_s = self.setpoint
            plant.state["setpoint_m"] = position_m + velocity_m_s * min(plant.time_s - self.since_s, LONGEST_S)

    def answer(self, line: str) -> str:
        """Carry one line out."""
        plant, words = self.rig.plant, line.split()
        if words[0] == "S":
            self.setpoint, self.since_s = (float(words[1]), float(words[2])), plant.time_s
        elif words[0] == "P":
            level = int(words[1])
            self.setpoint, self.since_s = (self.rig.actuator.seen_m, 0.0), plant.time_s
            if level and int(plant.command["mode"][0]) == records.MODE_OFF:
                plant.state["setpoint_m"] = self.rig.actuator.seen_m
            plant.order(mode=records.MODE_HOLD if level else records.MODE_OFF, pressure=level)
        shown = self.rig.bank.readings.status()
        clock_us = self.rig.actuator.clock.unwrapped_us(plant.time_s)
        numbers = (clock_us, shown["position"], shown["velocity"], shown["force"], plant.command["pressure"][0])
        return " ".join(f"{float(number):.9g}" if i else f"{float(number):.0f}" for i, number in enumerate(numbers))

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One client after the other."""
        while line := await reader.readline():
            writer.write(self.answer(line.decode()).encode() + b"\n")
        writer.close()


class PlainRig(SimulatedRig):
    """The simulated rig with that actuator in addition to its own, which receives no requests."""

    plain_url = ""

    async def open(self) -> Addresses:
        addresses = await super().open()
        server = await asyncio.start_server(PlainServer(self).serve, "127.0.0.1", 0)
        self.plain_url = f"tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        return addresses

    def bench(self, addresses: Addresses, real_time: bool) -> str:
        text = super().bench(addresses, real_time)
        text = text.replace(f'url = "{addresses.actuator_url}"', f'url = "{self.plain_url}"')
        text = text.replace('register_map = "demo"', 'register_map = "plain"')
        return "\n".join(line for line in text.splitlines() if "SIM-ACT" not in line) + "\n"


async def main(bench: Path) -> None:
    """Serve until terminated; the bench file is there once "ready" is said."""
    rig = PlainRig(RigOptions(), RunOptions())
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, rig.stop)
    rig.warm_up()
    text = rig.bench(await rig.open(), real_time=False)
    await asyncio.to_thread(bench.write_text, text, encoding="utf-8")
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    await rig.run()
    await rig.close()


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1])))
