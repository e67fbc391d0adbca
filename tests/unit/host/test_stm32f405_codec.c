/* The STM32F405's codec driver: codes from and to the words of the DMA, pauses, losses. Its registers are plain memory here. */
#include <string.h>

#include "unity.h"

#include <stdint.h>

static volatile uint32_t *plain_register(uint32_t address);
#define REGISTER(base, offset) (*plain_register((base) + (offset)))

#include "../../../hal/stm32f405/codec.c"
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
    TEST_ASSERT_EQUAL_UINT(IRQ_DMA1_Stream3, irq);
    TEST_ASSERT_EQUAL_UINT(BOARD_PRIORITY_SAMPLES, priority);
}

void converters_frame(const int32_t adc_raw[2], int32_t dac_raw[2])
{
    memcpy(seen, adc_raw, sizeof seen);
    memcpy(dac_raw, forces, sizeof forces);
    calls++;
}

/* The DMA has filled a block with a pair of codes, and is in the other one now. */
static void block_arrives(unsigned block, int32_t left, int32_t right)
{
    const uint32_t words[2] = {(uint32_t)left << 8, (uint32_t)right << 8};
    for (unsigned channel = 0; channel < 2; channel++) {
        received[block][2 * channel] = (uint16_t)(words[channel] >> 16);
        received[block][2 * channel + 1] = (uint16_t)words[channel];
    }
    DMA1_LISR = block == 0 ? DMA1_LISR_HTIF3 : DMA1_LISR_TCIF3;
    DMA1_S3NDTR = block == 0 ? BLOCK_WORDS : 2 * BLOCK_WORDS;
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

static void codes_keep_value_and_sign(void)
{
    static const int32_t codes[] = {0, 1, -1, 255, -256, 0x123456, -0x123456, 0x7FFFFF, -0x800000};
    const unsigned count = sizeof codes / sizeof codes[0];
    converters_connect();
    for (unsigned i = 0; i < count; i++) {
        forces[0] = codes[(i + 2) % count];
        forces[1] = codes[(i + 5) % count];
        block_arrives(i % 2, codes[i], codes[(i + 1) % count]);
        TEST_ASSERT_EQUAL_INT32(codes[i], seen[0]);
        TEST_ASSERT_EQUAL_INT32(codes[(i + 1) % count], seen[1]);
        TEST_ASSERT_EQUAL_INT32(forces[0], code_of(&transmitted[i % 2][0]));
        TEST_ASSERT_EQUAL_INT32(forces[1], code_of(&transmitted[i % 2][2]));
        TEST_ASSERT_EQUAL_UINT16(0, transmitted[i % 2][1] & 0xFF); /* the last 8 of 32 bits carry nothing */
    }
}

static void no_force_before_it_is_connected_and_in_a_pause(void)
{
    forces[0] = forces[1] = 1000;
    block_arrives(0, 5, 6);
    TEST_ASSERT_EQUAL_UINT(0, calls);
    TEST_ASSERT_EQUAL_INT32(0, code_of(&transmitted[0][0]));
    converters_connect();
    block_arrives(1, 5, 6);
    TEST_ASSERT_EQUAL_INT32(1000, code_of(&transmitted[1][0]));
    converters_pause();
    block_arrives(1, 5, 6);
    TEST_ASSERT_EQUAL_INT32(0, code_of(&transmitted[1][0]));
    converters_resume();
    block_arrives(0, 5, 6);
    TEST_ASSERT_EQUAL_INT32(1000, code_of(&transmitted[0][0]));
    TEST_ASSERT_EQUAL_UINT(2, calls);
}

static void a_missed_block_is_counted(void)
{
    converters_connect();
    block_arrives(0, 1, 1);
    TEST_ASSERT_EQUAL_UINT32(0, converters_samples_lost());
    DMA1_LISR = DMA1_LISR_HTIF3 | DMA1_LISR_TCIF3;
    converters_handler();
    TEST_ASSERT_EQUAL_UINT32(BOARD_BLOCK_FRAMES, converters_samples_lost());
}

static void dead_inputs_are_noticed(void)
{
    TEST_ASSERT_FALSE(converters_move() && calls > 0);
    low[0] = low[1] = INT32_MAX;
    high[0] = high[1] = INT32_MIN;
    TEST_ASSERT_FALSE(converters_move());
    block_arrives(0, 0x7FFFFF, 3);
    block_arrives(1, 0x7FFFFF, 4);
    TEST_ASSERT_FALSE(converters_move());
    block_arrives(0, 0x7FFFFE, 4);
    TEST_ASSERT_TRUE(converters_move());
}

static void set_up_gives_the_clock_divider_and_the_slave_before_the_master(void)
{
    converters_start();
    TEST_ASSERT_EQUAL_HEX32(0x302, SPI2_I2SPR);        /* master clock, odd: 2 x 2 + 1 = 5 */
    TEST_ASSERT_EQUAL_HEX32(0xE03, SPI2_I2SCFGR);      /* I2S, enabled, master transmits, 24 in 32 bits */
    TEST_ASSERT_EQUAL_HEX32(0xD03, I2S2ext_I2SCFGR);   /* I2S, enabled, slave receives, 24 in 32 bits */
    TEST_ASSERT_EQUAL_HEX32(0x06032D19, DMA1_S3CR);    /* channel 3, highest, half words, to memory, circular, two interrupts */
    TEST_ASSERT_EQUAL_HEX32(0x00032D41, DMA1_S4CR);    /* channel 0, the same, from memory */
    TEST_ASSERT_EQUAL_UINT32(2 * BLOCK_WORDS, DMA1_S3NDTR);
    TEST_ASSERT_EQUAL_HEX32(BIT(RESET_PIN), GPIOC_BSRR);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(codes_keep_value_and_sign);
    RUN_TEST(no_force_before_it_is_connected_and_in_a_pause);
    RUN_TEST(a_missed_block_is_counted);
    RUN_TEST(dead_inputs_are_noticed);
    RUN_TEST(set_up_gives_the_clock_divider_and_the_slave_before_the_master);
    return UNITY_END();
}
