/* The STM32F405's internal converters: codes around half the supply, one timer for all, losses. Its registers are plain memory here. */
#include <string.h>

#include "unity.h"

#include <stdint.h>

static volatile uint32_t *plain_register(uint32_t address);
#define REGISTER(base, offset)    (*plain_register((base) + (offset)))
#define BOARD_INTERNAL_CONVERTERS 1

#include "../../../hal/stm32f405/internal_converters.c"
#include "../../../hal/stm32f405/converters.c"

static uint32_t memory[0x30000 / 4]; /* 0x40000000 .. 0x4002FFFF */
static int32_t seen[2], forces[2];
static unsigned calls;

static volatile uint32_t *plain_register(uint32_t address)
{
    return &memory[(address - UINT32_C(0x40000000)) / 4];
}

void startup_enable_interrupt(unsigned irq, unsigned priority)
{
    TEST_ASSERT_EQUAL_UINT(18, irq);
    TEST_ASSERT_EQUAL_UINT(BOARD_PRIORITY_SAMPLES, priority);
}

void converters_frame(const int32_t adc_raw[2], int32_t dac_raw[2])
{
    memcpy(seen, adc_raw, sizeof seen);
    memcpy(dac_raw, forces, sizeof forces);
    calls++;
}

/* Both ADCs are through. */
static void codes_arrive(uint32_t primary, uint32_t secondary)
{
    ADC1_SR = ADC1_SR_EOC;
    ADC1_DR = primary;
    ADC2_DR = secondary;
    converters_handler();
}

void setUp(void)
{
    memset(memory, 0, sizeof memory);
    mode = MODE_SILENT;
    samples_lost = 0;
    calls = 0;
}

void tearDown(void)
{
}

static void codes_stand_around_half_the_supply(void)
{
    static const int32_t codes[] = {-2048, -1, 0, 1, 1000, 2047};
    const unsigned count = sizeof codes / sizeof codes[0];
    converters_connect();
    for (unsigned i = 0; i < count; i++) {
        int32_t other = codes[(i + 1) % count];
        forces[0] = codes[(i + 2) % count];
        forces[1] = codes[(i + 3) % count];
        codes_arrive((uint32_t)(codes[i] + 2048), (uint32_t)(other + 2048));
        TEST_ASSERT_EQUAL_INT32(codes[i], seen[0]);
        TEST_ASSERT_EQUAL_INT32(other, seen[1]);
        TEST_ASSERT_EQUAL_HEX32((uint32_t)(forces[0] + 2048) | (uint32_t)(forces[1] + 2048) << 16, DAC_DHR12RD);
    }
}

static void no_force_before_it_is_connected_and_in_a_pause(void)
{
    forces[0] = forces[1] = 1000;
    codes_arrive(5, 6);
    TEST_ASSERT_EQUAL_UINT(0, calls);
    TEST_ASSERT_EQUAL_HEX32(0x08000800, DAC_DHR12RD);
    converters_connect();
    codes_arrive(5, 6);
    TEST_ASSERT_EQUAL_HEX32(0x0BE80BE8, DAC_DHR12RD);
    converters_pause();
    codes_arrive(5, 6);
    TEST_ASSERT_EQUAL_HEX32(0x08000800, DAC_DHR12RD);
    TEST_ASSERT_EQUAL_UINT(1, calls);
}

static void an_overrun_is_counted_and_cleared(void)
{
    converters_connect();
    codes_arrive(1, 1);
    TEST_ASSERT_EQUAL_UINT32(0, converters_samples_lost());
    ADC1_SR = ADC1_SR_EOC | ADC1_SR_OVR;
    ADC2_SR = ADC1_SR_OVR;
    converters_handler();
    TEST_ASSERT_EQUAL_UINT32(1, converters_samples_lost());
    TEST_ASSERT_EQUAL_HEX32(0, (ADC1_SR | ADC2_SR) & ADC1_SR_OVR);
}

static void an_overrun_in_a_pause_is_no_loss(void)
{
    codes_arrive(1, 1);
    converters_connect();
    converters_pause();
    ADC1_SR = ADC1_SR_OVR;
    converters_resume();
    codes_arrive(1, 1);
    TEST_ASSERT_EQUAL_UINT32(0, converters_samples_lost());
}

static void one_timer_triggers_both_at_50_khz(void)
{
    converters_start();
    TEST_ASSERT_EQUAL_UINT32(84000000 / 50000, TIM2_ARR + 1);
    TEST_ASSERT_EQUAL_HEX32(0x20, TIM2_CR2);           /* its update is the trigger */
    TEST_ASSERT_EQUAL_HEX32(0x16000401, ADC1_CR2);     /* on, rising edge of timer 2, a flag for every code */
    TEST_ASSERT_EQUAL_HEX32(0x00000401, ADC2_CR2);     /* on, follows */
    TEST_ASSERT_EQUAL_HEX32(0x00010006, C_ADC_CCR);    /* 84 MHz / 4, both at one instant */
    TEST_ASSERT_EQUAL_UINT32(1, ADC1_SQR3);
    TEST_ASSERT_EQUAL_UINT32(2, ADC2_SQR3);
    TEST_ASSERT_EQUAL_HEX32(0x00250025, DAC_CR);       /* both on, on the same timer */
    TEST_ASSERT_EQUAL_HEX32(0x08000800, DAC_DHR12RD);
    TEST_ASSERT_EQUAL_HEX32(0xF3C, GPIOA_MODER);       /* PA1, PA2, PA4, PA5 analog */
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(codes_stand_around_half_the_supply);
    RUN_TEST(no_force_before_it_is_connected_and_in_a_pause);
    RUN_TEST(an_overrun_is_counted_and_cleared);
    RUN_TEST(an_overrun_in_a_pause_is_no_loss);
    RUN_TEST(one_timer_triggers_both_at_50_khz);
    return UNITY_END();
}
