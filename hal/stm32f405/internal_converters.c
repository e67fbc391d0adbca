/* The processor's own 12-bit converters, for bring-up: PA1 and PA2 sample both pickoffs at one instant, PA4 and PA5 are the forces; code zero stands at half the
 * supply. One timer triggers both: an answer that is computed before the next trigger leaves with it, one sample after its codes. */
#include "hal/stm32f405/board.h"
#include "hal/stm32f405/converters.h"
#include "hal/stm32f405/registers.h"
#include "hal/stm32f405/startup.h"

#define TIMER_HZ      84000000u
#define MIDDLE        2048
#define PRIMARY_PIN   1 /* of port A, and the ADCs' channel */
#define SECONDARY_PIN 2
#define SAMPLE_56     3 /* cycles of 21 MHz, 2.7 us: sources up to 10 kOhm */

enum { DIVIDE_BY_4 = 1, REGULAR_SIMULTANEOUS = 6 };
enum { TIM2_TRIGGERS_ADC = 6, RISING = 1, TIM2_TRIGGERS_DAC = 4, UPDATE_IS_TRIGGER = 2 };

/* ---- set-up -------------------------------------------------------------------------------------------------------------------- */

static void set_up_pins(void)
{
    RCC_AHB1ENR |= RCC_AHB1ENR_GPIOAEN;
    GPIOA_MODER |= FIELD(0xF, 2 * PRIMARY_PIN, 4) | FIELD(0xF, 8, 4); /* analog */
}

/* The second ADC follows the first one; both notice when a code was not fetched in time. */
static void set_up_adc(void)
{
    RCC_APB2ENR |= RCC_APB2ENR_ADC1EN | RCC_APB2ENR_ADC2EN;
    C_ADC_CCR = C_ADC_CCR_ADCPRE(DIVIDE_BY_4) | C_ADC_CCR_MULT(REGULAR_SIMULTANEOUS);
    ADC1_SMPR2 = FIELD(SAMPLE_56, 3 * PRIMARY_PIN, 3);
    ADC2_SMPR2 = FIELD(SAMPLE_56, 3 * SECONDARY_PIN, 3);
    ADC1_SQR3 = ADC1_SQR3_SQ1(PRIMARY_PIN);
    ADC2_SQR3 = ADC2_SQR3_SQ1(SECONDARY_PIN);
    ADC1_CR1 = ADC1_CR1_EOCIE;
    ADC2_CR2 = ADC2_CR2_ADON | ADC2_CR2_EOCS;
    ADC1_CR2 = ADC1_CR2_ADON | ADC1_CR2_EOCS | ADC1_CR2_EXTEN(RISING) | ADC1_CR2_EXTSEL(TIM2_TRIGGERS_ADC);
}

static void put_forces(int32_t drive, int32_t rebalance)
{
    DAC_DHR12RD = DAC_DHR12RD_DACC1DHR(drive + MIDDLE) | DAC_DHR12RD_DACC2DHR(rebalance + MIDDLE);
}

static void set_up_dac(void)
{
    RCC_APB1ENR |= RCC_APB1ENR_DACEN;
    put_forces(0, 0);
    DAC_CR = DAC_CR_EN1 | DAC_CR_TEN1 | DAC_CR_TSEL1(TIM2_TRIGGERS_DAC) | DAC_CR_EN2 | DAC_CR_TEN2 | DAC_CR_TSEL2(TIM2_TRIGGERS_DAC);
}

static void start_timer(void)
{
    RCC_APB1ENR |= RCC_APB1ENR_TIM2EN;
    TIM2_ARR = TIMER_HZ / BOARD_SAMPLE_RATE_HZ - 1;
    TIM2_CR2 = TIM2_CR2_MMS(UPDATE_IS_TRIGGER);
    TIM2_CR1 = TIM2_CR1_CEN;
}

void converters_start(void)
{
    set_up_pins();
    set_up_adc();
    set_up_dac();
    startup_enable_interrupt(BOARD_SAMPLES_IRQ, BOARD_PRIORITY_SAMPLES);
    start_timer();
}

/* ---- interrupt ----------------------------------------------------------------------------------------------------------------- */

/* An overrun stops the ADCs until it is cleared: one pair at least was missed. Reading a code clears its flag. */
void converters_handler(void)
{
    if ((ADC1_SR & ADC1_SR_OVR) != 0) {
        converters_note_lost(1);
        converters_driver_forget();
    }
    const int32_t adc_raw[2] = {(int32_t)(ADC1_DR & 0xFFF) - MIDDLE, (int32_t)(ADC2_DR & 0xFFF) - MIDDLE};
    int32_t dac_raw[2];
    converters_exchange(adc_raw, dac_raw);
    put_forces(dac_raw[0], dac_raw[1]);
}

void converters_driver_forget(void)
{
    ADC1_SR = 0;
    ADC2_SR = 0;
}
