/* What a call of an exported observer costs: on the board its instructions, by the timer that
 * firmware/board/src/meter.rs tells of; on this computer its shortest time in ns.
 * REAL, U, DT and CURRENT say how the functions are called. */

#include "o.h"

#include <stdint.h>
#include <stdio.h>

enum { CALLS = 500, RUNS = 60000 };

static o_state state;

__attribute__((noinline)) static int nothing(REAL y, REAL u)
{
    __asm__ volatile("" ::: "memory");
    return y > u;
}

__attribute__((noinline)) static int called(REAL y, REAL u)
{
    (void)u;
#ifdef CURRENT
    const int status = o_correct(&state, y);
    return status + o_predict(&state U DT);
#else
    return o_step(&state, y U, 0.0 DT);
#endif
}

static REAL next(REAL y)
{
    return y > (REAL)0.5 ? (REAL)0.1 : y + (REAL)0.001;
}

#ifdef BOARD

static volatile uint32_t *const timer = (volatile uint32_t *)0x40000000u;

static uint32_t instructions(int (*function)(REAL, REAL), REAL y)
{
    const uint32_t before = timer[1];
    function(y, (REAL)0.5);
    return before - timer[1];
}

int main(void)
{
    uint64_t ticks = 0;
    REAL y = (REAL)0.1;
    int k;
    timer[0] = 0;
    timer[2] = timer[1] = 0xffffffffu;
    timer[0] = 1;
    o_init(&state);
    for (k = 0; k < CALLS; ++k) {
        y = next(y);
        ticks += instructions(called, y) - instructions(nothing, y);
    }
    printf("%.1f\n", (double)ticks / 25.6 / CALLS);
    return 0;
}

#else

#include <time.h>

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

int main(void)
{
    double best = 1e30;
    REAL y = (REAL)0.1;
    int k, run, sum = nothing(y, y);
    o_init(&state);
    for (run = 0; run < RUNS; ++run) {
        const double before = now();
        double passed;
        for (k = 0; k < CALLS; ++k) {
            y = next(y);
            sum += called(y, (REAL)0.5);
        }
        passed = now() - before;
        best = passed < best ? passed : best;
    }
    printf("%.2f %d\n", best / CALLS, sum & 1);
    return 0;
}

#endif
