/* State from a recording: what is taken is written back byte for byte, but for booleans, and its counts, shifts and choices are within
 * their tables. The numbers of a state are trusted (application/snapshot.h), so nothing runs from here. First byte of the input: bit 0 sets version and size right, bit 1 begins from a sound snapshot with bytes replaced. */
#include <string.h>

#include "fuzz.h"
#include "hal/host/wineglass_device.h"

#define LONGEST 4096

static const struct wg_device_cfg cfg = {.sample_rate_millihz = 50000000, .adc_bits = 16, .dac_bits = 16, .serial = 1};

static size_t build(struct fuzz_input *input, const struct wg_device *device, uint8_t bytes[LONGEST])
{
    uint8_t how = fuzz_u8(input);
    const uint8_t *rest;
    uint8_t header[4];
    size_t size = (size_t)wg_device_snapshot(device, bytes, LONGEST);
    memcpy(header, bytes, sizeof header);
    if ((how & 2) != 0) {
        for (unsigned words = fuzz_u8(input) % 16; words > 0; words--) {
            size_t at = fuzz_u16(input) % size;
            bytes[at] = fuzz_u8(input);
        }
    } else {
        size_t count = fuzz_bytes(input, LONGEST, &rest);
        memcpy(bytes, rest, count);
        size = (how & 1) != 0 ? size : count;
    }
    if ((how & 1) != 0) {
        memcpy(bytes, header, sizeof header);
    }
    return size;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct wg_device *device;
    static uint8_t sound[LONGEST], bytes[LONGEST], again[LONGEST];
    struct fuzz_input input = {data, size};
    if (device == NULL) {
        device = wg_device_create(&cfg, NULL, 0);
        FUZZ_CHECK(device != NULL);
        FUZZ_CHECK(wg_device_snapshot(device, sound, LONGEST) > 0);
    }
    FUZZ_CHECK(wg_device_restore(device, sound, wg_device_snapshot_size()) == 0);
    size_t count = build(&input, device, bytes);
    if (wg_device_restore(device, bytes, count) == 0) {
        FUZZ_CHECK(wg_device_snapshot(device, again, LONGEST) == (int64_t)count);
        const struct gyro_cfg *gyro = device->app.cfg;
        FUZZ_CHECK(gyro->output_filter < OUTPUT_FILTER_COUNT && gyro->lockin.decimation >= 8 && gyro->dac_shift == 16);
        FUZZ_CHECK(gyro->acquisition.decimation == gyro->lockin.decimation && gyro->loops_per_slow >= 1);
        again[0] = bytes[0];
        FUZZ_CHECK(wg_device_restore(device, again, count) == 0);
    }
    return 0;
}
