/* The core alone, linked with nothing that does not belong to it: what it takes of flash and memory, and what it needs of libraries. */
#include "core/gyro.h"

void footprint(const struct gyro_input *input, struct gyro_output *output);

static struct gyro_cfg cfg;
static struct gyro_state state;

void footprint(const struct gyro_input *input, struct gyro_output *output)
{
    gyro_reset(&cfg, &state);
    *output = gyro_step(&cfg, &state, input);
}
