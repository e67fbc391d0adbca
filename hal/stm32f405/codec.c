/* The external stereo codec on I2S2, full duplex through DMA. Left is the primary axis, right the secondary one. The codec needs no control port. */
#include "hal/stm32f405/board.h"
#include "hal/stm32f405/converters.h"
#include "hal/stm32f405/registers.h"
#include "hal/stm32f405/startup.h"

#define WORDS_PER_FRAME 4 /* two channels of two 16-bit words, the upper one first */
#define BLOCK_WORDS     (BOARD_BLOCK_FRAMES * WORDS_PER_FRAME)

#define RESET_PIN       7 /* of port C, low resets */
#define RESET_LOOPS     20000

enum { DATA_24_BITS = 1, STANDARD_PHILIPS = 0, SLAVE_RECEIVES = 1, MASTER_TRANSMITS = 2 };
enum { TO_PERIPHERAL = 1, HALF_WORDS = 1, HIGHEST = 3, CHANNEL_SPI2_TX = 0, CHANNEL_I2S2_EXT_RX = 3 };

static volatile uint16_t received[2][BLOCK_WORDS], transmitted[2][BLOCK_WORDS];

/* ---- set-up -------------------------------------------------------------------------------------------------------------------- */

/* PB12 word select, PB13 bit clock, PB14 from the codec (function 6), PB15 to the codec, PC6 master clock (function 5), PC7 reset. */
static void set_up_pins(void)
{
    RCC_AHB1ENR |= RCC_AHB1ENR_GPIOBEN | RCC_AHB1ENR_GPIOCEN;
    GPIOB_AFRH = (GPIOB_AFRH & ~FIELD(0xFFFF, 16, 16)) | FIELD(0x5655, 16, 16);
    GPIOB_OSPEEDR |= FIELD(0x55, 24, 8);
    GPIOB_MODER = (GPIOB_MODER & ~FIELD(0xFF, 24, 8)) | FIELD(0xAA, 24, 8);
    GPIOC_AFRL = (GPIOC_AFRL & ~FIELD(0xF, 24, 4)) | FIELD(0x5, 24, 4);
    GPIOC_OSPEEDR |= FIELD(0x2, 12, 2);
    GPIOC_BSRR = BIT(RESET_PIN + 16);
    GPIOC_MODER = (GPIOC_MODER & ~FIELD(0xF, 12, 4)) | FIELD(0x6, 12, 4);
}

static void set_up_i2s(void)
{
    RCC_APB1ENR |= RCC_APB1ENR_SPI2EN;
    SPI2_I2SPR = SPI2_I2SPR_MCKOE | SPI2_I2SPR_I2SDIV(BOARD_I2S_DIVIDER / 2) | (BOARD_I2S_DIVIDER % 2 != 0 ? SPI2_I2SPR_ODD : 0);
    SPI2_I2SCFGR = SPI2_I2SCFGR_I2SMOD | SPI2_I2SCFGR_I2SCFG(MASTER_TRANSMITS) | SPI2_I2SCFGR_I2SSTD(STANDARD_PHILIPS) |
                   SPI2_I2SCFGR_DATLEN(DATA_24_BITS) | SPI2_I2SCFGR_CHLEN;
    I2S2ext_I2SCFGR = I2S2ext_I2SCFGR_I2SMOD | I2S2ext_I2SCFGR_I2SCFG(SLAVE_RECEIVES) | I2S2ext_I2SCFGR_I2SSTD(STANDARD_PHILIPS) |
                      I2S2ext_I2SCFGR_DATLEN(DATA_24_BITS) | I2S2ext_I2SCFGR_CHLEN;
    SPI2_CR2 = SPI2_CR2_TXDMAEN;
    I2S2ext_CR2 = I2S2ext_CR2_RXDMAEN;
}

static void set_up_dma(void)
{
    RCC_AHB1ENR |= RCC_AHB1ENR_DMA1EN;
    DMA1_S3PAR = (uint32_t)(uintptr_t)&I2S2ext_DR;
    DMA1_S3M0AR = (uint32_t)(uintptr_t)received;
    DMA1_S3NDTR = 2 * BLOCK_WORDS;
    DMA1_S3CR = DMA1_S3CR_CHSEL(CHANNEL_I2S2_EXT_RX) | DMA1_S3CR_PL(HIGHEST) | DMA1_S3CR_MSIZE(HALF_WORDS) |
                DMA1_S3CR_PSIZE(HALF_WORDS) | DMA1_S3CR_MINC | DMA1_S3CR_CIRC | DMA1_S3CR_HTIE | DMA1_S3CR_TCIE;
    DMA1_S4PAR = (uint32_t)(uintptr_t)&SPI2_DR;
    DMA1_S4M0AR = (uint32_t)(uintptr_t)transmitted;
    DMA1_S4NDTR = 2 * BLOCK_WORDS;
    DMA1_S4CR = DMA1_S4CR_CHSEL(CHANNEL_SPI2_TX) | DMA1_S4CR_DIR(TO_PERIPHERAL) | DMA1_S4CR_PL(HIGHEST) |
                DMA1_S4CR_MSIZE(HALF_WORDS) | DMA1_S4CR_PSIZE(HALF_WORDS) | DMA1_S4CR_MINC | DMA1_S4CR_CIRC;
    DMA1_S3CR |= DMA1_S3CR_EN;
    DMA1_S4CR |= DMA1_S4CR_EN;
}

void converters_start(void)
{
    set_up_pins();
    set_up_i2s();
    set_up_dma();
    startup_enable_interrupt(BOARD_SAMPLES_IRQ, BOARD_PRIORITY_SAMPLES);
    I2S2ext_I2SCFGR |= I2S2ext_I2SCFGR_I2SE; /* the slave first, so that it sees the first word select */
    SPI2_I2SCFGR |= SPI2_I2SCFGR_I2SE;
    for (uint32_t i = 0; i < RESET_LOOPS; i++) { /* the codec wants its master clock before reset ends */
        GPIOC_BSRR = BIT(RESET_PIN + 16);
    }
    GPIOC_BSRR = BIT(RESET_PIN);
}

/* ---- interrupt ----------------------------------------------------------------------------------------------------------------- */

/* 24 bits at the top of two 16-bit words. */
static int32_t code_of(const volatile uint16_t words[2])
{
    return (int32_t)((uint32_t)words[0] << 16 | words[1]) >> 8;
}

static void put_code(volatile uint16_t words[2], int32_t code)
{
    words[0] = (uint16_t)((uint32_t)code >> 8);
    words[1] = (uint16_t)((uint32_t)code << 8);
}

static void one_frame(const volatile uint16_t in[WORDS_PER_FRAME], volatile uint16_t out[WORDS_PER_FRAME])
{
    const int32_t adc_raw[2] = {code_of(in), code_of(in + 2)};
    int32_t dac_raw[2];
    converters_exchange(adc_raw, dac_raw);
    put_code(out, dac_raw[0]);
    put_code(out + 2, dac_raw[1]);
}

/* The block that is complete is the one the DMA is not in. When both flags stand, the one before it was missed. */
void converters_handler(void)
{
    uint32_t flags = DMA1_LISR & (DMA1_LISR_HTIF3 | DMA1_LISR_TCIF3);
    uint32_t block = DMA1_S3NDTR > BLOCK_WORDS ? 1 : 0;
    DMA1_LIFCR = DMA1_LIFCR_CHTIF3 | DMA1_LIFCR_CTCIF3;
    if (flags == (DMA1_LISR_HTIF3 | DMA1_LISR_TCIF3)) {
        converters_note_lost(BOARD_BLOCK_FRAMES);
    }
    for (unsigned i = 0; i < BLOCK_WORDS; i += WORDS_PER_FRAME) {
        one_frame(&received[block][i], &transmitted[block][i]);
    }
}

void converters_driver_forget(void)
{
    DMA1_LIFCR = DMA1_LIFCR_CHTIF3 | DMA1_LIFCR_CTCIF3;
}
