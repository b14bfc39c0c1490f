/* `sim HOST:PORT MISSION`: drive a simulated robot over a socket, one output per input, by the robot's clock. */
#define _POSIX_C_SOURCE 200112L
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <unistd.h>

#include "runner.h"

/* Receive a whole struct; returns 1, or 0 if the connection is closed. */
static int receive_all(int link, void *to, size_t size)
{
    return recv(link, to, size, MSG_WAITALL) == (ssize_t)size;
}

static int send_all(int link, const void *from, size_t size)
{
    const char *at = from;
    while (size > 0) {
        ssize_t sent = send(link, at, size, MSG_NOSIGNAL);
        if (sent <= 0) return 0;
        at += sent;
        size -= (size_t)sent;
    }
    return 1;
}

static int connect_to(const char *place)
{
    char host[128];
    const char *colon = strrchr(place, ':');
    struct addrinfo want, *found = NULL;
    int link = -1, one = 1;
    if (colon == NULL || (size_t)(colon - place) >= sizeof host) return -1;
    memcpy(host, place, (size_t)(colon - place));
    host[colon - place] = 0;
    memset(&want, 0, sizeof want);
    want.ai_family = AF_INET;
    want.ai_socktype = SOCK_STREAM;
    if (getaddrinfo(host, colon + 1, &want, &found) != 0) return -1;
    link = socket(found->ai_family, found->ai_socktype, found->ai_protocol);
    if (link >= 0 && connect(link, found->ai_addr, found->ai_addrlen) != 0) {
        close(link);
        link = -1;
    }
    if (link >= 0) setsockopt(link, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    freeaddrinfo(found);
    return link;
}

/* Receive the robot's description; returns NULL, or why the robot is refused. */
static const char *meet(int link, const char *model, int32_t odometry)
{
    static sp_sim_hello hello;
    static char reason[256];
    const char *names[SP_NAMES];
    const size_t front = sizeof hello.interface; /* another interface may have another length */
    if (!receive_all(link, hello.interface, front) || memcmp(hello.interface, SP_RUNNER_INTERFACE, front) != 0 ||
        !receive_all(link, (char *)&hello + front, sizeof hello - front))
        return "the simulator has another interface; valid: one of this export";
    sp_found robot = {.model = hello.model, .name_count = hello.name_count, .names = names};
    hello.model[sizeof hello.model - 1] = 0;
    for (int k = 0; k < SP_NAMES; k++) {
        hello.names[k][sizeof hello.names[k] - 1] = 0;
        names[k] = hello.names[k];
    }
    memcpy(robot.rates, hello.rates, sizeof robot.rates);
    if (!sp_agree(&robot, model, odometry, reason, sizeof reason)) return reason;
    sp_say_absent(&robot);
    return NULL;
}

int sp_sim(const sp_parameters *p, const char *place, const char *mission, const char *log, int residual)
{
    static sp_run run;
    sp_loop_input input;
    sp_loop_output output;
    if (sp_run_open(&run, p, mission, log, residual) != 0) return 2;
    int link = connect_to(place);
    if (link < 0)
        return sp_reject("", "no simulator there; valid: the HOST:PORT that `spidar sitl --link socket` prints");
    const char *why = meet(link, p->model, run.loop.mission.odometry);
    while (why == NULL && receive_all(link, &input, sizeof input)) {
        sp_run_tick(&run, &input, &output, -1.0);
        if (!send_all(link, &output, sizeof output)) break;
    }
    close(link);
    return why == NULL ? sp_run_close(&run) : sp_reject("", why);
}
