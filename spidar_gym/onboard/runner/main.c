/* The runner: what drives the robot, and what checks the core without one. */
#define _POSIX_C_SOURCE 200112L
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "bench.h"
#include "log.h"
#include "ros1.h"
#include "sim.h"
#include "spidar_model.h"

static const char *const MESSAGES[] = {
    "",
    "no log; valid: one that `spidar export` or this runner wrote",
    "the log is of another interface or robot; valid: one of this export",
    "the log ends early; valid: a whole one",
    "the log asks for what this export cannot do; valid: one of this very export",
    "cannot write the output; valid: a path in a writable folder",
    "an output differs from the golden one by more than 1e-6",
    "the run replays otherwise; valid: the runner that wrote it",
    "the output is the log itself; valid: another file",
};

static int fail(int code)
{
    fprintf(stderr, "runner: %s\n", MESSAGES[code]);
    return 2;
}

/* Whether two paths are one file. */
static int same(const char *a, const char *b)
{
    struct stat x, y;
    return stat(a, &x) == 0 && stat(b, &y) == 0 && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}

static int replay(const char *from, const char *to)
{
    FILE *in = fopen(from, "rb"), *out;
    if (in == NULL) return fail(1);
    if (same(from, to)) {
        fclose(in);
        return fail(8);
    }
    out = fopen(to, "wb");
    if (out == NULL) {
        fclose(in);
        return fail(5);
    }
    int ticks = 0, differ = 0, code = sp_replay(in, out, &ticks, &differ);
    fclose(in);
    if (fclose(out) != 0 && code == 0) code = 5;
    if (code != 0) {
        remove(to);
        return fail(code);
    }
    if (ticks > 0) printf("%d ticks of a run, %d answered otherwise than then\n", ticks, differ);
    return differ > 0 ? fail(7) : 0;
}

/* Largest difference of two outputs; negative where their lengths differ. */
static int compare(const char *a, const char *b)
{
    FILE *one = fopen(a, "rb"), *two = fopen(b, "rb");
    double worst = 0.0;
    int ticks = 0, whole = one != NULL && two != NULL;
    sp_log_output x, y;
    while (whole) {
        size_t left = fread(&x, sizeof x, 1, one), right = fread(&y, sizeof y, 1, two);
        if (left != right) whole = 0;
        if (left != 1 || right != 1) break;
        const double *p = (const double *)&x.command, *q = (const double *)&y.command;
        for (size_t k = 0; k < (sizeof x.command + sizeof x.forces_l) / sizeof(double); k++) {
            double d = p[k] - q[k];
            if (!(d <= worst && -d <= worst)) worst = d < 0 ? -d : d;
        }
        ticks++;
    }
    if (one != NULL) fclose(one);
    if (two != NULL) fclose(two);
    if (!whole) return fail(3);
    printf("%d ticks, largest difference %.3g\n", ticks, worst);
    return worst <= 1e-6 ? 0 : fail(6);
}

typedef struct {
    const char *log, *space, *out;
    int residual;
} options;

/* What follows a mission; 0 where a word is none of these. */
static int read_options(int count, char **words, options *o)
{
    o->log = NULL;
    o->space = o->out = "/spidar";
    o->residual = 0;
    int named = 0;
    for (int k = 0; k < count; k++) {
        if (strcmp(words[k], "--residual") == 0) o->residual = 1;
        else if (k + 1 == count) return 0;
        else if (strcmp(words[k], "--log") == 0) o->log = words[++k];
        else if (strcmp(words[k], "--namespace") == 0) o->space = words[++k];
        else if (strcmp(words[k], "--out") == 0) o->out = words[++k], named = 1;
        else return 0;
    }
    if (!named) o->out = o->space;
    return 1;
}

static int run_link(int count, char **words)
{
    options o;
    if (strcmp(words[1], "sim") == 0 && count >= 4 && read_options(count - 4, words + 4, &o))
        return sp_sim(words[2], words[3], o.log, o.residual);
    if (strcmp(words[1], "ros1") == 0 && count >= 3 && read_options(count - 3, words + 3, &o)) {
#ifdef SPIDAR_ROS1
        return sp_ros1(words[2], o.space, o.out, o.log, o.residual);
#else
        fprintf(stderr, "runner: compiled without ROS 1; valid: a build where roscpp is found, see README.md\n");
        return 2;
#endif
    }
    return -1;
}

int main(int count, char **words)
{
    if (count == 4 && strcmp(words[1], "replay") == 0) return replay(words[2], words[3]);
    if (count == 4 && strcmp(words[1], "compare") == 0) return compare(words[2], words[3]);
    if (count == 3 && strcmp(words[1], "bench") == 0) return sp_bench(words[2]);
    if (count == 2 && strcmp(words[1], "about") == 0) {
        printf("interface %s\nmodel %s\n", SP_RUNNER_INTERFACE, SP_MODEL_SHA256);
        return 0;
    }
    int done = count > 1 ? run_link(count, words) : -1;
    if (done >= 0) return done;
    fprintf(stderr, "usage: runner replay IN OUT | compare OUT GOLDEN | bench IN | about\n"
                    "       runner sim HOST:PORT MISSION [--log FILE] [--residual]\n"
                    "       runner ros1 MISSION [--namespace /spidar] [--out /spidar_dry] [--log FILE] [--residual]\n");
    return 2;
}
