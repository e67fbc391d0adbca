/* Built against the installed library: the headers must be found under their own names. */
#include "core/fixed.h"

int main(void)
{
    bool overflow = false;
    int32_t clamped = fixed_saturate_i32(INT64_C(1) << 40, &overflow);
    return clamped == INT32_MAX && overflow ? 0 : 1;
}
