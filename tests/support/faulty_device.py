"""A Modbus TCP device that fails as devices and networks do."""
import os
import struct

from live_test import Device

HEADER = struct.Struct(">HHHB")


class FaultyDevice(Device):
    """`fault`: None, or the name of a method below that returns the bytes to send instead of the answer."""

    fault, connections = None, 0

    def _serve(self, client):
        self.connections += 1
        with client, client.makefile("rb") as requests:
            try:
                while len(header := requests.read(7)) == 7:
                    transaction, _, length, unit = HEADER.unpack(header)
                    request = requests.read(length - 1)
                    self.functions.add(request[0])
                    reply = self._reply(request)
                    whole = HEADER.pack(transaction, 0, len(reply) + 1, unit) + reply
                    sent = whole if self.fault is None else getattr(self, self.fault)(whole)
                    if sent is None:
                        return
                    client.sendall(sent)
            except OSError:
                return

    def silence(self, _):
        return b""

    def garbage(self, _):
        return os.urandom(23)

    def exception(self, whole):
        return HEADER.pack(*HEADER.unpack(whole[:7])[:2], 3, whole[6]) + bytes((whole[7] | 0x80, 4))

    def exception_0(self, whole):
        return self.exception(whole)[:8] + bytes((0,))

    def other_unit(self, whole):
        return whole[:6] + bytes((whole[6] ^ 7,)) + whole[7:]

    def other_protocol(self, whole):
        return whole[:3] + bytes((1,)) + whole[4:]

    def other_length(self, whole):
        return whole[:4] + bytes((255, 255)) + whole[6:]

    def half_frame(self, whole):
        return whole[:len(whole) // 2]

    def other_answer(self, whole):
        """The answer to another transaction, for example to one that has timed out."""
        return bytes((whole[0] ^ 0x55, whole[1] ^ 0x55)) + whole[2:]

    def storm(self, _):
        """Drops the connection."""
        return None
