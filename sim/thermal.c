#include "sim/thermal.h"

#include "sim/electronics.h"
#include "sim/matrix4.h"

/* y = (shell, thermometer, chamber, slope of the chamber), y' = rates y */
enum { SHELL, THERMOMETER, CHAMBER, SLOPE };

/* A lag of zero copies the row of what is followed. */
static struct matrix4 rates_over(const struct thermal_cfg *cfg, const struct thermal_plan *plan, double duration_s)
{
    struct matrix4 rates = {0};
    matrix4_set(&rates, CHAMBER, SLOPE, duration_s);
    if (plan->shell_follows) {
        matrix4_set(&rates, SHELL, SLOPE, duration_s);
    } else {
        matrix4_set(&rates, SHELL, CHAMBER, duration_s / cfg->shell_time_constant_s);
        matrix4_set(&rates, SHELL, SHELL, -duration_s / cfg->shell_time_constant_s);
    }
    if (plan->thermometer_follows) {
        for (int column = 0; column < 4; column++) {
            matrix4_set(&rates, THERMOMETER, column, matrix4_get(&rates, SHELL, column));
        }
    } else {
        matrix4_set(&rates, THERMOMETER, SHELL, duration_s / cfg->thermometer_lag_s);
        matrix4_set(&rates, THERMOMETER, THERMOMETER, -duration_s / cfg->thermometer_lag_s);
    }
    return rates;
}

static struct thermal_map map_over(const struct thermal_cfg *cfg, const struct thermal_plan *plan, double duration_s)
{
    struct matrix4 response, integral;
    struct matrix4 rates = rates_over(cfg, plan, duration_s);
    matrix4_exponential(&rates, &response, &integral);
    return (struct thermal_map){
        .duration_s = duration_s,
        .shell_kept = matrix4_get(&response, SHELL, SHELL),
        .shell_ramp = matrix4_get(&response, SHELL, SLOPE),
        .thermometer_kept = matrix4_get(&response, THERMOMETER, THERMOMETER),
        .thermometer_shell = matrix4_get(&response, THERMOMETER, SHELL),
        .thermometer_ramp = matrix4_get(&response, THERMOMETER, SLOPE),
    };
}

void thermal_init(const struct thermal_cfg *cfg, double block_s, struct thermal_plan *plan, struct thermal_point *now)
{
    plan->shell_follows = cfg->shell_imposed != 0 || cfg->shell_time_constant_s == 0.0;
    plan->thermometer_follows = cfg->thermometer_lag_s == 0.0;
    plan->half = map_over(cfg, plan, 0.5 * block_s);
    plan->whole = map_over(cfg, plan, block_s);
    now->chamber_degc = now->shell_degc = now->thermometer_degc = cfg->initial_degc;
}

/* In deviations from the chamber's temperature, so that an equilibrium stays one to the last bit. */
static struct thermal_point advance(const struct thermal_plan *plan, const struct thermal_map *map, const struct thermal_point *from,
                                    double slope_degc_s, double chamber_end_degc)
{
    double chamber = from->chamber_degc;
    double shell = from->shell_degc - chamber;
    double thermometer = from->thermometer_degc - chamber;
    struct thermal_point to = {.chamber_degc = chamber_end_degc};
    to.shell_degc = chamber + (map->shell_kept * shell + map->shell_ramp * slope_degc_s);
    to.thermometer_degc = chamber + (map->thermometer_kept * thermometer + map->thermometer_shell * shell
                                     + map->thermometer_ramp * slope_degc_s);
    if (plan->shell_follows) {
        to.shell_degc = chamber_end_degc;
    }
    if (plan->thermometer_follows) {
        to.thermometer_degc = to.shell_degc;
    }
    return to;
}

void thermal_step(const struct thermal_plan *plan, struct thermal_point *now, double chamber_end_degc, struct thermal_point *middle)
{
    double slope = (chamber_end_degc - now->chamber_degc) / plan->whole.duration_s;
    double chamber_middle = now->chamber_degc + slope * plan->half.duration_s;
    *middle = advance(plan, &plan->half, now, slope, chamber_middle);
    *now = advance(plan, &plan->whole, now, slope, chamber_end_degc);
}

int32_t thermometer_code(const struct thermal_cfg *cfg, double measured_degc)
{
    double code = (measured_degc - cfg->thermometer_offset_degc) / cfg->thermometer_lsb_degc;
    if (code >= INT32_MAX) {
        return INT32_MAX;
    }
    if (code <= -INT32_MAX) {
        return -INT32_MAX;
    }
    return (int32_t)round_to_even(code);
}

double thermometer_degc(const struct thermal_cfg *cfg, int32_t code)
{
    return cfg->thermometer_offset_degc + code * cfg->thermometer_lsb_degc;
}
