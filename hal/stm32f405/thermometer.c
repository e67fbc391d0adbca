#include "hal/stm32f405/thermometer.h"

#include "hal/stm32f405/registers.h"
#include "hal/stm32f405/ticks.h"

#define READ_ADDRESS  (0x48u << 1 | 1u) /* its register pointer stands at the temperature since power-up */
#define BUS_HZ        100000u
#define INTERVAL_MS   100
#define PATIENCE_MS   5    /* 30 bits take 0.3 ms */
#define OLD_AFTER_MS  1000

/*  REST -- interval over: start --> STARTED -- sent: address --> ADDRESSED -- answered --> READING -- two bytes --> REST
 *   ^------------------------------- no answer, or patience over: reset the bus unit ------------------------------' */
enum state { REST, STARTED, ADDRESSED, READING };

static enum state state;
static uint32_t apb1_mhz, began_ms, answered_ms;
static int32_t code;
static bool answered;

/* PB6 clock, PB7 data: alternate function 4, open drain, pull-ups on the board. */
static void set_up_pins(void)
{
    RCC_AHB1ENR |= RCC_AHB1ENR_GPIOBEN;
    GPIOB_OTYPER |= BIT(6) | BIT(7);
    GPIOB_AFRL = (GPIOB_AFRL & ~FIELD(0xFF, 24, 8)) | FIELD(0x44, 24, 8);
    GPIOB_MODER = (GPIOB_MODER & ~FIELD(0xF, 12, 4)) | FIELD(0xA, 12, 4);
}

static void set_up_bus(void)
{
    I2C1_CR1 = I2C1_CR1_SWRST;
    I2C1_CR1 = 0;
    I2C1_CR2 = I2C1_CR2_FREQ(apb1_mhz);
    I2C1_CCR = I2C1_CCR_CCR(apb1_mhz * 1000000u / (2 * BUS_HZ));
    I2C1_TRISE = apb1_mhz + 1;
    I2C1_CR1 = I2C1_CR1_PE;
}

void thermometer_start(uint32_t apb1_hz)
{
    apb1_mhz = apb1_hz / 1000000u;
    set_up_pins();
    RCC_APB1ENR |= RCC_APB1ENR_I2C1EN;
    set_up_bus();
    began_ms = ticks_ms() - INTERVAL_MS;
}

/* Two bytes: the second one is not acknowledged, which POS announces one byte ahead. */
static enum state begin(uint32_t now_ms)
{
    began_ms = now_ms;
    I2C1_CR1 = I2C1_CR1_PE | I2C1_CR1_ACK | I2C1_CR1_POS | I2C1_CR1_START;
    return STARTED;
}

static enum state address(void)
{
    I2C1_DR = READ_ADDRESS;
    return ADDRESSED;
}

static enum state prepare_last_byte(void)
{
    (void)I2C1_SR2; /* reading it lets the bus go on */
    I2C1_CR1 &= ~I2C1_CR1_ACK;
    return READING;
}

static enum state fetch(uint32_t now_ms)
{
    I2C1_CR1 |= I2C1_CR1_STOP;
    uint32_t high = I2C1_DR & 0xFF;
    uint32_t low = I2C1_DR & 0xFF;
    code = (int16_t)(uint16_t)(high << 8 | low);
    answered = true;
    answered_ms = now_ms;
    return REST;
}

static enum state give_up(void)
{
    I2C1_CR1 |= I2C1_CR1_STOP;
    set_up_bus();
    return REST;
}

static enum state next(uint32_t now_ms)
{
    uint32_t flags = I2C1_SR1;
    if (state == REST) {
        return now_ms - began_ms >= INTERVAL_MS ? begin(now_ms) : REST;
    }
    if ((flags & I2C1_SR1_AF) != 0 || now_ms - began_ms > PATIENCE_MS) {
        return give_up();
    }
    if (state == STARTED) {
        return (flags & I2C1_SR1_SB) != 0 ? address() : STARTED;
    }
    if (state == ADDRESSED) {
        return (flags & I2C1_SR1_ADDR) != 0 ? prepare_last_byte() : ADDRESSED;
    }
    return (flags & I2C1_SR1_BTF) != 0 ? fetch(now_ms) : READING;
}

bool thermometer_read(void *context, int32_t *raw)
{
    uint32_t now_ms = ticks_ms();
    (void)context;
    state = next(now_ms);
    answered = answered && now_ms - answered_ms < OLD_AFTER_MS;
    *raw = code;
    return answered;
}
