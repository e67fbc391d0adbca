/* State from a recording: what is taken is written back byte for byte, but for booleans, and whatever it is, the firmware goes on from it over any
 * codes without leaving its types. First byte of the input: bit 0 sets version and size right, bit 1 begins from a sound snapshot with bytes
 * replaced, bits 2 and 3 say which one. */
#include <string.h>

#include "fuzz.h"
#include "hal/host/wineglass_device.h"

#define LONGEST 4096
#define STATES  4

static const struct wg_device_cfg cfg = {.sample_rate_millihz = 50000000, .adc_bits = 16, .dac_bits = 16, .serial = 1};
static uint8_t sound[STATES][LONGEST];

/* A resonator of a kind, on 5 kHz: 36 degrees a sample, Q = 1e4. */
struct shell {
    double x, v;
    int32_t adc[2];
};

static void ring(struct wg_device *device, struct shell *shell, uint32_t samples)
{
    const double cosine = 0.80901699437494745, sine = 0.58778525229247314, decay = 0.99997;
    int32_t dac[2];
    for (uint32_t i = 0; i < samples; i++) {
        wg_device_run(device, 1, shell->adc, dac);
        double v = shell->v + 1e-4 * dac[0] / 32768.0;
        shell->v = decay * (cosine * v - sine * shell->x);
        shell->x = decay * (cosine * shell->x + sine * v);
        shell->adc[0] = (int32_t)(32000.0 * shell->x);
        shell->adc[1] = shell->adc[0] / 1000;
    }
}

/* The compiled-in calibration has no rebalance loops; these are slow ones. */
static void close_rebalance(struct wg_device *device)
{
    for (unsigned i = 0; i < 2; i++) {
        struct gyro_cfg *gyro = &device->board.app.cfgs[i];
        gyro->rebalance = (struct rebalance_cfg){10 << 16, 1 << 10, 1 << 30, 1 << 30};
        gyro->rebalance_scale_rad_s_q28.coef[0] = 1 << 29;
        gyro->loop = GYRO_LOOP_REBALANCE;
    }
}

/* Searching, listening, driven, and in rebalance. */
static struct wg_device *create(void)
{
    static const uint32_t samples[STATES] = {1003, 6505, 60001, 5003};
    struct shell shell = {0.0, 0.0, {0, 0}};
    struct wg_device *device = wg_device_create(&cfg, NULL, 0);
    FUZZ_CHECK(device != NULL);
    for (unsigned state = 0; state < STATES; state++) {
        if (state == STATES - 1) {
            close_rebalance(device);
        }
        ring(device, &shell, samples[state]);
        FUZZ_CHECK(wg_device_snapshot(device, sound[state], LONGEST) > 0);
        FUZZ_CHECK(wg_device_restore(device, sound[state], wg_device_snapshot_size()) == 0);
    }
    return device;
}

static size_t build(struct fuzz_input *input, uint8_t bytes[LONGEST])
{
    uint8_t how = fuzz_u8(input);
    const uint8_t *rest;
    const uint8_t *from = sound[how >> 2 & (STATES - 1)];
    size_t size = wg_device_snapshot_size();
    memcpy(bytes, from, size);
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
        memcpy(bytes, from, 4);
    }
    return size;
}

/* Codes from the input, then its last ones again and again; over more than a slow period, so that every task has run. */
static void run_on(struct wg_device *device, struct fuzz_input *input)
{
    const uint32_t samples = wg_device_slow_period(device) + 40;
    int32_t adc[2] = {0, 0}, dac[2];
    wg_device_set_thermometer(device, (int32_t)fuzz_u32(input));
    for (uint32_t i = 0; i < samples; i++) {
        if (input->left >= 4) {
            adc[0] = (int16_t)fuzz_u16(input);
            adc[1] = (int16_t)fuzz_u16(input);
        }
        wg_device_run(device, 1, adc, dac);
        FUZZ_CHECK(dac[0] >= -32768 && dac[0] <= 32767 && dac[1] >= -32768 && dac[1] <= 32767);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static struct wg_device *device;
    static uint8_t bytes[LONGEST], again[LONGEST], trash[1024];
    struct fuzz_input input = {data, size};
    if (device == NULL) {
        device = create();
    }
    size_t count = build(&input, bytes);
    int32_t reason = wg_device_restore(device, bytes, count);
    FUZZ_CHECK(reason == REASON_OK || reason == REASON_SNAPSHOT_VERSION || reason == REASON_SNAPSHOT_RANGE || reason == REASON_SNAPSHOT_BOARD);
    if (reason == REASON_OK) {
        FUZZ_CHECK(wg_device_snapshot(device, again, LONGEST) == (int64_t)count);
        FUZZ_CHECK(wg_device_restore(device, again, count) == 0);
        run_on(device, &input);
        while (wg_device_telemetry_read(device, trash, sizeof trash) > 0) {
        }
    }
    return 0;
}
