/* Built against the installed library: the headers must be found under their own names, and the archives must be whole.
 * A device without a plant: its pickoffs see silence, it must still answer with DAC codes and telemetry. */
#include "core/fixed.h"
#include "hal/hal.h"
#include "hal/host/wineglass_device.h"
#include "sim/twin.h"

enum { SAMPLES = 5000 };

int main(void)
{
    static int32_t adc[2 * SAMPLES];
    static int32_t dac[2 * SAMPLES];
    const struct wg_device_cfg cfg = {.sample_rate_millihz = 50000000, .adc_bits = 16, .dac_bits = 16, .serial = 1};

    struct wg_device *device = wg_device_create(&cfg, 0, 0);
    if (device == 0) {
        return 1;
    }
    wg_device_run(device, SAMPLES, adc, dac);
    struct wg_device_signals signals;
    wg_device_get_signals(device, &signals);
    wg_device_destroy(device);
    return signals.sample_counter == SAMPLES ? 0 : 2;
}
