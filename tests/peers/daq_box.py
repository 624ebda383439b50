"""A data-acquisition device of another make: a Modbus TCP server of pymodbus, and a CAN node of python-can.

It shares no code with the product. What it measures it takes from text lines, as a conditioner sends them; the voltage
at its output it passes on to a bench supply as SCPI. So a whole campaign can run against it on the simulated rig.

    python daq_box.py FORCE_PORT TRAVEL_PORT SUPPLY_PORT       Modbus: AIN0, AIN1, DAC0, AIN2 (V); prints its port
    python daq_box.py FORCE_PORT TRAVEL_PORT - CAN_CHANNEL     CAN by udp_multicast: 0x181 force, 0x182 travel
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import struct
import sys
from typing import Any

import can
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

NUMBER = re.compile(rb"[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
AIN, DAC0, SERIAL = (0, 2, 4), 1000, 60028
NEWTON_PER_V, MM_PER_V, AMPERE_PER_V, MONITOR_A_PER_V = 2000.0, 10.0, 0.4, 0.5


class Box:
    """What it measures and gives out."""

    def __init__(self) -> None:
        self.floats = dict.fromkeys((*AIN, DAC0), 0.0)
        self.words: dict[int, int] = {SERIAL: 0, SERIAL + 1: 470}
        self.supply: asyncio.StreamWriter | None = None
        self.changed = asyncio.Event()

    async def listen(self, port: int, register: int, per_V: float, sent: asyncio.Queue[float] | None = None) -> None:
        """Follow one conditioner's lines."""
        reader, _ = await asyncio.open_connection("127.0.0.1", port)
        while line := await reader.readline():
            if (found := NUMBER.search(line)) is not None:
                self.floats[register] = float(found[0]) / per_V
                if sent is not None:
                    sent.put_nowait(self.floats[register])

    async def drive(self, port: int) -> None:
        """Set the supply to the output's voltage, and measure what it gives."""
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        for text in ("VOLT 24", "OUTP ON"):
            writer.write(f"{text}\n".encode())
        last = -1.0
        while True:
            wanted = self.floats[DAC0] * AMPERE_PER_V
            if wanted != last:
                writer.write(f"CURR {wanted:.4f}\n".encode())
                last = wanted
            writer.write(b"MEAS:CURR?\n")
            answer = NUMBER.search(await reader.readline())
            self.floats[AIN[2]] = float(answer[0]) / MONITOR_A_PER_V if answer else 0.0
            await asyncio.sleep(0.02)

    async def action(
        self, function: int, start: int, address: int, count: int, registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> None:
        """One access of a client."""
        if values is not None:
            self.words |= {address + place: word for place, word in enumerate(values)}
            if address == DAC0 and count == 2:
                self.floats[DAC0] = struct.unpack(">f", struct.pack(">2H", *values))[0]
            return
        shown = dict(self.words)
        for first, volts in self.floats.items():
            shown[first], shown[first + 1] = struct.unpack(">2H", struct.pack(">f", volts))
        for place in range(count):
            registers[address - start + place] = shown.get(address + place, 0)


async def modbus(box: Box) -> None:
    server = ModbusTcpServer(
        SimDevice(1, simdata=[SimData(0, count=61_700, values=0, datatype=DataType.REGISTERS)], action=box.action),
        address=("127.0.0.1", 0),
    )
    await server.serve_forever(background=True)
    listener: Any = server.transport
    print(listener.sockets[0].getsockname()[1], flush=True)  # noqa: T201 - its answer to who started it
    await asyncio.Event().wait()


async def on_bus(channel: str, identifier: int, sent: asyncio.Queue[float]) -> None:
    """Send a frame for each value, also if several arrive at once: a signed 32-bit number of thousandths, a counter."""
    with can.Bus(interface="udp_multicast", channel=channel) as bus:
        if identifier == 0x181:
            print("ready", flush=True)  # noqa: T201 - its answer to who started it
        count = 0
        while True:
            data = struct.pack("<iB", round(1000.0 * await sent.get()), count & 0xFF)
            bus.send(can.Message(arbitration_id=identifier, is_extended_id=False, data=data))
            count += 1


async def main() -> None:
    box = Box()
    force, travel, supply, *channel = sys.argv[1:]
    if channel:
        values: tuple[asyncio.Queue[float], asyncio.Queue[float]] = asyncio.Queue(), asyncio.Queue()
        await asyncio.gather(
            box.listen(int(force), AIN[0], 1.0, values[0]), box.listen(int(travel), AIN[1], 1.0, values[1]),
            on_bus(channel[0], 0x181, values[0]), on_bus(channel[0], 0x182, values[1]),
        )
    await asyncio.gather(
        box.listen(int(force), AIN[0], NEWTON_PER_V), box.listen(int(travel), AIN[1], MM_PER_V), box.drive(int(supply)),
        modbus(box),
    )


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(main())
