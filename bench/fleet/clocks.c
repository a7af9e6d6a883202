/* Lets a process live by a clock of its own: wrong by an offset, and running at another rate.

   MERLIN_CLOCK="OFFSET RATE ORIGIN": the date is OFFSET seconds ahead; since the moment ORIGIN of the machine's
   CLOCK_MONOTONIC all clocks run RATE times as fast. Preloaded into every process of a robot, which then agree with each
   other, as those of a computer do. What reads a clock sees the robot's time; what waits until a moment of the robot's time
   waits until that moment. Waits of a given length stay as they are: they are off by the rate. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <linux/futex.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000LL

typedef int64_t ns_t;
typedef struct timespec spec;

static double rate = 1.0;
static ns_t offset = 0, origin = 0;

static int (*real_gettime)(clockid_t, spec *);
static int (*real_nanosleep)(clockid_t, int, const spec *, spec *);
static int (*real_clockwait)(sem_t *, clockid_t, const spec *);
static int (*real_timedwait)(sem_t *, const spec *);
static int (*real_cond_clockwait)(pthread_cond_t *, pthread_mutex_t *, clockid_t, const spec *);
static int (*real_cond_timedwait)(pthread_cond_t *, pthread_mutex_t *, const spec *);
static long (*real_syscall)(long, ...);

static void *find(const char *name, const char *version)
{
  void *found = version ? dlvsym(RTLD_NEXT, name, version) : NULL;
  return found ? found : dlsym(RTLD_NEXT, name);
}

__attribute__((constructor)) static void begin(void)
{
  if (real_gettime)
    return;
  const char *text = getenv("MERLIN_CLOCK");
  char *rest = (char *)text;
  if (text) {
    offset = (ns_t)(strtod(rest, &rest) * SECOND);
    rate = strtod(rest, &rest);
    origin = (ns_t)(strtod(rest, &rest) * SECOND);
  }
  real_nanosleep = find("clock_nanosleep", NULL);
  real_clockwait = find("sem_clockwait", NULL);
  real_timedwait = find("sem_timedwait", NULL);
  real_cond_clockwait = find("pthread_cond_clockwait", NULL);
  real_cond_timedwait = find("pthread_cond_timedwait", "GLIBC_2.3.2"); /* the older one has other conditions */
  real_syscall = find("syscall", NULL);
  real_gettime = find("clock_gettime", NULL);
}

static ns_t in_ns(const spec *at) { return at->tv_sec * SECOND + at->tv_nsec; }

static void to_spec(ns_t at, spec *out)
{
  if (at < 0)
    at = 0;
  out->tv_sec = at / SECOND;
  out->tv_nsec = at % SECOND;
}

static int is_date(clockid_t clock) { return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE; }

static int is_robots(clockid_t clock)
{
  return is_date(clock) || clock == CLOCK_MONOTONIC || clock == CLOCK_MONOTONIC_COARSE ||
         clock == CLOCK_MONOTONIC_RAW || clock == CLOCK_BOOTTIME;
}

static ns_t machine_now(clockid_t clock)
{
  spec now;
  begin();
  real_gettime(clock, &now);
  return in_ns(&now);
}

static ns_t robot_now(clockid_t clock)
{
  ns_t gained = (ns_t)((machine_now(CLOCK_MONOTONIC) - origin) * (rate - 1.0));
  return machine_now(clock) + gained + (is_date(clock) ? offset : 0);
}

/* When a moment of the robot's time comes, by the machine's clock. */
static spec machine_time(clockid_t clock, const spec *at)
{
  spec out;
  to_spec(machine_now(clock) + (ns_t)((in_ns(at) - robot_now(clock)) / rate), &out);
  return out;
}

int clock_gettime(clockid_t clock, spec *out)
{
  begin();
  if (!is_robots(clock))
    return real_gettime(clock, out);
  to_spec(robot_now(clock), out);
  return 0;
}

int gettimeofday(struct timeval *restrict out, void *restrict zone)
{
  ns_t now = robot_now(CLOCK_REALTIME);
  (void)zone;
  out->tv_sec = now / SECOND;
  out->tv_usec = now % SECOND / 1000;
  return 0;
}

time_t time(time_t *out)
{
  time_t now = robot_now(CLOCK_REALTIME) / SECOND;
  if (out)
    *out = now;
  return now;
}

int clock_nanosleep(clockid_t clock, int flags, const spec *request, spec *remain)
{
  begin();
  if (!(flags & TIMER_ABSTIME) || !is_robots(clock))
    return real_nanosleep(clock, flags, request, remain);
  spec until = machine_time(clock, request);
  return real_nanosleep(clock, flags, &until, remain);
}

int sem_clockwait(sem_t *semaphore, clockid_t clock, const spec *at)
{
  spec until = machine_time(clock, at);
  return real_clockwait(semaphore, clock, &until);
}

int sem_timedwait(sem_t *semaphore, const spec *at)
{
  spec until = machine_time(CLOCK_REALTIME, at);
  return real_timedwait(semaphore, &until);
}

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock, const spec *at)
{
  spec until = machine_time(clock, at);
  return real_cond_clockwait(condition, mutex, clock, &until);
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const spec *at)
{
  /* The condition knows its clock and does not tell; a machine that has run for 30 years would be taken for a date. */
  spec until = machine_time(at->tv_sec > SECOND ? CLOCK_REALTIME : CLOCK_MONOTONIC, at);
  return real_cond_timedwait(condition, mutex, &until);
}

/* gRPC reads clocks and waits on futexes by this. */
long syscall(long number, ...)
{
  long a[6];
  va_list given;
  va_start(given, number);
  for (int i = 0; i < 6; i++)
    a[i] = va_arg(given, long);
  va_end(given);
  if (number == SYS_clock_gettime)
    return clock_gettime((clockid_t)a[0], (spec *)a[1]);
  begin();
  if (number == SYS_futex && a[3] && (a[1] & FUTEX_CMD_MASK) == FUTEX_WAIT_BITSET) {
    spec until = machine_time(a[1] & FUTEX_CLOCK_REALTIME ? CLOCK_REALTIME : CLOCK_MONOTONIC, (spec *)a[3]);
    return real_syscall(number, a[0], a[1], a[2], &until, a[4], a[5]);
  }
  return real_syscall(number, a[0], a[1], a[2], a[3], a[4], a[5]);
}
