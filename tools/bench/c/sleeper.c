/* Wakes up on absolute beats and prints how late each wake-up was.
 *
 * sleeper PERIOD_NS COUNT: one line of nanoseconds for each beat. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static long long now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

int main(int argc, char **argv)
{
    if (argc != 3) {
        fprintf(stderr, "usage: sleeper PERIOD_NS COUNT\n");
        return 2;
    }
    long long period = atoll(argv[1]);
    long count = atol(argv[2]);
    long long *late = malloc(sizeof *late * (size_t)count);
    if (!late)
        return 1;
    long long anchor = now_ns();
    for (long k = 0; k < count; k++) {
        long long due = anchor + (k + 1) * period;
        struct timespec until = {due / 1000000000LL, due % 1000000000LL};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINTR)
            ;
        late[k] = now_ns() - due;
    }
    for (long k = 0; k < count; k++)
        printf("%lld\n", late[k]);
    free(late);
    return 0;
}
