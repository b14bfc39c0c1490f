/* How long a tick takes. */
#ifndef SPIDAR_BENCH_H
#define SPIDAR_BENCH_H

int sp_bench(const char *log);

#endif
