/* The runner's command line: drive the robot, or check and time the core without a robot. */
#include <stdio.h>
#include <string.h>

#include "runner.h"
#include "spidar_model.h"

typedef struct {
    const char *log, *space, *out;
    int residual;
} options;

/* Read the options after the mission; returns 0 for an unknown option. */
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
        return sp_reject("", "compiled without ROS 1; valid: a build where roscpp is found, see README.md");
#endif
    }
    return -1;
}

int main(int count, char **words)
{
    if (count == 4 && strcmp(words[1], "replay") == 0) return sp_replay(words[2], words[3]);
    if (count == 4 && strcmp(words[1], "compare") == 0) return sp_compare(words[2], words[3]);
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
