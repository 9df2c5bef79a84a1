"""An Inspire hand out of pymodbus' server, another author's Modbus: its registers are found by the byte
address that the hand's manual gives, and each taxel has another value.

python inspire_modbus.py PORT PADS, with pymodbus 3.11.3 (later ones don't ask a data block of one's own)
"""

import asyncio
import json
import sys

from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.server import StartAsyncTcpServer

pads = json.loads(sys.argv[2])  # first byte and number of values of each pad, in the order of their values
registers = {}
for count, byte in enumerate(first + 2 * k for first, size in pads for k in range(size)):
    registers[byte] = count * 7 % 4096


class Hand(ModbusSequentialDataBlock):
    def __init__(self):
        super().__init__(0, [0])

    def validate(self, address, count=1):
        return True

    def getValues(self, address, count=1):
        first = address - 1  # pymodbus counts registers from 1
        return [registers.get(first + 2 * k, 0) for k in range(count)]


hand = Hand()
context = ModbusServerContext(devices=ModbusDeviceContext(hr=hand, ir=hand, di=hand, co=hand), single=True)
asyncio.run(StartAsyncTcpServer(context, address=("127.0.0.1", int(sys.argv[1]))))
