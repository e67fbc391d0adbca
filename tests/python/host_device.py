"""A device of the host port for tests: codes in, codes out, telemetry and commands as bytes."""

import numpy as np

from wineglass.native import ffi, library, pointer


class Device:
    """A device of the host port with pickoff codes of a ringing shell, or any others."""

    def __init__(self, block=b"", adc_bits=16, dac_bits=16, serial=99):
        cfg = ffi.new("struct wg_device_cfg *", {"sample_rate_millihz": 50_000_000, "adc_bits": adc_bits, "dac_bits": dac_bits,
                                                 "serial": serial})
        self.handle = library().wg_device_create(cfg, block or ffi.NULL, len(block))
        assert self.handle != ffi.NULL
        self._destroy = library().wg_device_destroy
        self.samples = 0

    def run(self, adc):
        adc = np.ascontiguousarray(adc, np.int32)
        dac = np.empty_like(adc)
        library().wg_device_run(self.handle, len(adc), pointer(adc, "int32_t"), pointer(dac, "int32_t"))
        self.samples += len(adc)
        return dac

    def ring(self, n):
        t = np.arange(self.samples, self.samples + n)
        return self.run(np.stack([np.round(20000 * np.cos(0.2 * np.pi * t)), np.round(300 * np.sin(0.2 * np.pi * t + 0.3))], axis=1))

    def send(self, data):
        assert library().wg_device_command_write(self.handle, data, len(data)) == 0

    def telemetry(self):
        count = library().wg_device_telemetry_pending(self.handle)
        buffer = ffi.new("uint8_t[]", max(count, 1))
        assert library().wg_device_telemetry_read(self.handle, buffer, count) == count
        return bytes(ffi.buffer(buffer, count))

    def __del__(self):
        if hasattr(self, "_destroy"):
            self._destroy(self.handle)
