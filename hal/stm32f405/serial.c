#include "hal/stm32f405/serial.h"

#include "application/ring.h"
#include "hal/hal.h"
#include "hal/stm32f405/board.h"
#include "hal/stm32f405/registers.h"
#include "hal/stm32f405/startup.h"

#define TRANSMIT_BYTES 2048u /* 22 ms: a snapshot's burst beside the steady frames */
#define RECEIVE_BYTES  256u  /* 2.8 ms between two polls */

static struct ring transmit_ring, receive_ring;
static uint8_t transmit_bytes[TRANSMIT_BYTES], receive_bytes[RECEIVE_BYTES];

/* PA9 sends, PA10 receives (pulled up: an open input is a quiet one); alternate function 7. */
static void set_up_pins(void)
{
    RCC_AHB1ENR |= RCC_AHB1ENR_GPIOAEN;
    GPIOA_MODER = (GPIOA_MODER & ~FIELD(0xF, 18, 4)) | FIELD(0xA, 18, 4);
    GPIOA_PUPDR = (GPIOA_PUPDR & ~FIELD(0xF, 18, 4)) | FIELD(0x4, 18, 4);
    GPIOA_AFRH = (GPIOA_AFRH & ~FIELD(0xFF, 4, 8)) | FIELD(0x77, 4, 8);
}

void serial_start(uint32_t apb2_hz)
{
    set_up_pins();
    RCC_APB2ENR |= RCC_APB2ENR_USART1EN;
    USART1_BRR = (apb2_hz + BOARD_BAUD / 2) / BOARD_BAUD;
    USART1_CR1 = USART1_CR1_UE | USART1_CR1_TE | USART1_CR1_RE | USART1_CR1_RXNEIE;
    startup_enable_interrupt(IRQ_USART1, BOARD_PRIORITY_SERIAL);
}

static void receive(void)
{
    uint32_t index;
    uint8_t byte = (uint8_t)USART1_DR; /* reading it also clears an overrun */
    if (ring_slot(&receive_ring, RECEIVE_BYTES, &index)) {
        receive_bytes[index] = byte;
        ring_put(&receive_ring);
    } /* else it is lost, and the frame's CRC will tell */
}

static bool transmit(void)
{
    if (ring_waiting(&transmit_ring) == 0) {
        return false;
    }
    USART1_DR = transmit_bytes[ring_index(&transmit_ring, TRANSMIT_BYTES, 0)];
    ring_drop(&transmit_ring, 1);
    return true;
}

void usart1_handler(void)
{
    uint32_t status = USART1_SR;
    if ((status & (USART1_SR_RXNE | USART1_SR_ORE)) != 0) {
        receive();
    }
    if ((status & USART1_SR_TXE) != 0 && (USART1_CR1 & USART1_CR1_TXEIE) != 0 && !transmit()) {
        USART1_CR1 &= ~USART1_CR1_TXEIE;
    }
}

/* The first byte or two go from here, the interrupt sends the rest. (An emulated line is always free, and may not know this
 * interrupt: there everything goes from here.) The interrupt can only clear the bit that is cleared and set here. */
static void begin_transmission(void)
{
    USART1_CR1 &= ~USART1_CR1_TXEIE;
    while ((USART1_SR & USART1_SR_TXE) != 0 && transmit()) {
    }
    USART1_CR1 |= USART1_CR1_TXEIE;
}

int serial_write(void *context, const uint8_t *bytes, size_t count)
{
    uint32_t index;
    (void)context;
    if (count > TRANSMIT_BYTES - ring_waiting(&transmit_ring)) {
        return HAL_ERROR_BUSY;
    }
    for (size_t i = 0; i < count && ring_slot(&transmit_ring, TRANSMIT_BYTES, &index); i++) {
        transmit_bytes[index] = bytes[i];
        ring_put(&transmit_ring);
    }
    begin_transmission();
    return HAL_OK;
}

size_t serial_read(void *context, uint8_t *bytes, size_t capacity)
{
    size_t count = 0;
    (void)context;
    while (count < capacity && ring_waiting(&receive_ring) > 0) {
        bytes[count++] = receive_bytes[ring_index(&receive_ring, RECEIVE_BYTES, 0)];
        ring_drop(&receive_ring, 1);
    }
    return count;
}
