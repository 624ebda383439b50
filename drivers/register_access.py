"""Registers and coils by plan: requests of reads and writes over one link, together where the device can."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.errors import Busy, NoAnswer, OtherAnswer, RequestRefused, WrongAnswer
from drivers.modbus_link import READ_RETRIES, ModbusLink
from drivers.register_maps.access_plan import Read, Rules, Written, reads
from drivers.register_maps.condition import Values
from drivers.register_maps.quantity import HOLDING, MASK_WRITE, Quantity, Value
from drivers.unreadable import READ_FUNCTIONS, explained
from protocols.errors import RemoteProtocolError

WRITE_REGISTERS = 16


class RegisterAccess:
    """Reads and writes over a link.

    Args:
        link: the connection.
        rules: what may be read together.
        together: function 23 may be used.

    Attributes:
        explains: a block that was never read, and cannot be, is looked into part by part: while a device is connected.
    """

    def __init__(self, link: ModbusLink, rules: Rules, *, together: bool) -> None:
        self._link = link
        self._rules = rules
        self._together = together
        self.explains = False
        self._known: set[tuple[str, int, int]] = set()

    @property
    def device(self) -> str:
        """Name of the device, for errors."""
        return self._link.device

    @property
    def url(self) -> str:
        """Address of the device, for errors."""
        return self._link.url

    def read(
        self, reads: Sequence[Read], name: str, requests: Sequence[Written] = (), *, once: bool = False
    ) -> dict[str, Value]:
        """Write, then read, in one trip where the device can.

        Args:
            reads: what is read.
            name: of it, for messages.
            requests: what is written before.
            once: what is written is out of date when it would be written again; else that is harmless.

        Returns:
            The values (SI) by name.

        Raises:
            WrongAnswer: the words do not make up what is read.
            DriverError: the controller cannot be reached.
        """
        values: dict[str, Value] = {}
        single = len(requests) == 1 and requests[0].function == WRITE_REGISTERS and not requests[0].mask
        together = self._together and single and bool(reads) and reads[0].space == HOLDING
        if not together:
            for request in requests:
                (self.write if once else self._write_again)(request)
        try:
            for place, read in enumerate(reads):
                one = requests[0] if together and place == 0 else None
                values |= read.decode(self.words(read, one, retries=0 if once else READ_RETRIES))
        except RemoteProtocolError as error:
            raise WrongAnswer(self._link.device, self._link.url, f"{name}: {error}") from error
        return values

    def words(self, read: Read, request: Written | None = None, *, retries: int = READ_RETRIES) -> list[int]:
        """The words of one read, with a write in the same trip where one is given.

        Raises:
            RequestRefused: the controller does not give it.
            NoAnswer: no answer.
            OtherAnswer: the answer is one to something else.
            explained: what was found instead of these three (`WrongLayout`).
            DriverError: the controller cannot be reached.
        """
        key = read.space, read.address, read.count
        try:
            if request is not None:
                return self._link.exchange(
                    read.address, read.count, request.address, request.words, retries=retries
                )
            words = self._link.read(read.address, read.count, READ_FUNCTIONS[read.space])
        except (RequestRefused, NoAnswer, OtherAnswer) as error:
            if not self.explains or key in self._known or isinstance(error, Busy) or request is not None:
                raise
            raise explained(self._link, read, self._rules, error, heard=bool(self._known)) from error
        self._known.add(key)
        return words

    def show(self, quantities: frozenset[Quantity]) -> Values:
        """What the device shows now of these (SI).

        Raises:
            DriverError: it cannot be read.
        """
        return self.read(reads(quantities, self._rules), "wait")

    def write(self, request: Written) -> None:
        """Perform one write, once; single bits are written by a mask or inserted into the current word.

        The word is read before each such write, because a bit that the device has cleared itself must not be set again.

        Raises:
            DriverError: the controller cannot be reached, or refuses.
        """
        words, kept = request.words, 0xFFFF ^ request.mask
        if request.mask and request.function == MASK_WRITE:
            words = (kept, words[0])
        elif request.mask:
            words = (self._link.read(request.address, 1)[0] & kept | words[0],)
        self._link.write(request.address, words, request.function)

    def _write_again(self, request: Written) -> None:
        """A write that is harmless to repeat: once more after silence.

        Raises:
            NoAnswer: no answer, and the connection was given up.
            WrongAnswer: not an answer to this write, and the connection was given up.
            DriverError: the second one fails, too.
        """
        try:
            self.write(request)
        except (NoAnswer, WrongAnswer):
            if not self._link.is_open:
                raise
            self.write(request)
