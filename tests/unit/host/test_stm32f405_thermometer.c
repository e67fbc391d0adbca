/* The STM32F405's thermometer driver, event by event, with a bus that answers, is silent, or hangs. */
#include <string.h>

#include "unity.h"

#include <stdint.h>

static volatile uint32_t *plain_register(uint32_t address);
#define REGISTER(base, offset) (*plain_register((base) + (offset)))

#include "../../../hal/stm32f405/thermometer.c"

static uint32_t memory[0x30000 / 4];
static uint32_t now_ms;
static uint8_t answer[2];
static unsigned answer_next;

/* Reading the data register gives the next byte. */
static volatile uint32_t *plain_register(uint32_t address)
{
    volatile uint32_t *found = &memory[(address - UINT32_C(0x40000000)) / 4];
    if (address == I2C1_BASE + 0x10 && state == READING) {
        *found = answer[answer_next++ & 1];
    }
    return found;
}

uint32_t ticks_ms(void)
{
    return now_ms;
}

static bool poll(int32_t *raw)
{
    return thermometer_read(NULL, raw);
}

void setUp(void)
{
    memset(memory, 0, sizeof memory);
    now_ms = 5000;
    state = REST;
    answered = false;
    answer_next = 0;
    thermometer_start(42000000);
}

void tearDown(void)
{
}

static void converse(int16_t temperature)
{
    int32_t raw;
    answer[0] = (uint8_t)((uint16_t)temperature >> 8);
    answer[1] = (uint8_t)temperature;
    poll(&raw);
    TEST_ASSERT_BITS(I2C1_CR1_START, I2C1_CR1_START, I2C1_CR1);
    I2C1_SR1 = I2C1_SR1_SB;
    poll(&raw);
    TEST_ASSERT_EQUAL_HEX32(0x91, I2C1_DR);
    I2C1_SR1 = I2C1_SR1_ADDR;
    poll(&raw);
    TEST_ASSERT_EQUAL_HEX32(0, I2C1_CR1 & I2C1_CR1_ACK);
    I2C1_SR1 = I2C1_SR1_BTF;
    poll(&raw);
    TEST_ASSERT_BITS(I2C1_CR1_STOP, I2C1_CR1_STOP, I2C1_CR1);
    I2C1_SR1 = 0;
}

static void temperatures_keep_their_sign(void)
{
    static const int16_t codes[] = {3200, -1, -5120, 32767, -32768};
    for (unsigned i = 0; i < sizeof codes / sizeof codes[0]; i++) {
        int32_t raw = 0;
        converse(codes[i]);
        TEST_ASSERT_TRUE(poll(&raw));
        TEST_ASSERT_EQUAL_INT32(codes[i], raw);
        now_ms += INTERVAL_MS;
    }
}

static void an_answer_grows_old(void)
{
    int32_t raw;
    converse(3200);
    now_ms += OLD_AFTER_MS - 1;
    TEST_ASSERT_TRUE(poll(&raw));
    now_ms += 1;
    TEST_ASSERT_FALSE(poll(&raw));
}

static void silence_and_refusal_end_the_conversation(void)
{
    int32_t raw;
    poll(&raw);
    now_ms += PATIENCE_MS + 1;
    TEST_ASSERT_FALSE(poll(&raw));
    TEST_ASSERT_EQUAL_INT(REST, state);
    TEST_ASSERT_EQUAL_HEX32(I2C1_CR1_PE, I2C1_CR1);
    now_ms += INTERVAL_MS;
    poll(&raw);
    I2C1_SR1 = I2C1_SR1_SB;
    poll(&raw);
    I2C1_SR1 = I2C1_SR1_AF;
    TEST_ASSERT_FALSE(poll(&raw));
    TEST_ASSERT_EQUAL_INT(REST, state);
}

static void the_bus_has_its_speed(void)
{
    TEST_ASSERT_EQUAL_UINT32(210, I2C1_CCR); /* 42 MHz / (2 x 100 kHz) */
    TEST_ASSERT_EQUAL_UINT32(43, I2C1_TRISE); /* 1 us */
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(temperatures_keep_their_sign);
    RUN_TEST(an_answer_grows_old);
    RUN_TEST(silence_and_refusal_end_the_conversation);
    RUN_TEST(the_bus_has_its_speed);
    return UNITY_END();
}
