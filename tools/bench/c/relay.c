/* Stamps packets and their answers from outside, the same way for all that answer.
 *
 * relay echo tcp|udp PACKET ANSWER: answers each packet of PACKET bytes with its first ANSWER bytes, as fast as C can.
 * relay send tcp|udp PORT FILE PACKET ANSWER PERIOD_NS COUNT: sends numbered packets on absolute beats to an echo.
 * relay pass tcp PORT FILE: stands between a robot that listens on PORT and its client, which connects to here.
 * relay pass udp PORT FILE: stands between a robot that sends to here and its client, which is bound to PORT.
 *
 * The first line of the output is the port that is listened to. FILE is written when the stream ends, or by SIGTERM:
 * a `struct record` for all bytes that were forwarded at once, and these bytes. A packet's time is taken right before
 * it is sent on, an answer's right after it has been read.
 */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { PACKET, ANSWER, LARGEST = 65536, ROOM = 1 << 27 };

struct record { double at; uint32_t way, size; };

static unsigned char bytes[LARGEST], *kept;
static size_t filled;
static volatile sig_atomic_t ended;

static void fail(const char *what)
{
    fprintf(stderr, "relay: %s: %s\n", what, strerror(errno));
    exit(1);
}

static void end(int number)
{
    (void)number;
    ended = 1;
}

static double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void stamp(uint32_t way, size_t size)
{
    struct record record = {now_s(), way, (uint32_t)size};
    if (filled + sizeof record + size > ROOM) {
        ended = 1;
        return;
    }
    memcpy(kept + filled, &record, sizeof record);
    memcpy(kept + filled + sizeof record, bytes, size);
    filled += sizeof record + size;
}

/* A socket that is connected to PORT, or listens on a free one, which is printed. */
static int open_socket(int type, int port)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    socklen_t size = sizeof address;
    int on = 1, fd = socket(AF_INET, type, 0);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (fd < 0)
        fail("socket");
    if (type == SOCK_STREAM)
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    if (port) {
        if (connect(fd, (struct sockaddr *)&address, size) < 0)
            fail("connect");
        return fd;
    }
    if (bind(fd, (struct sockaddr *)&address, size) < 0 || (type == SOCK_STREAM && listen(fd, 1) < 0) ||
        getsockname(fd, (struct sockaddr *)&address, &size) < 0)
        fail("listen");
    printf("%d\n", ntohs(address.sin_port));
    fflush(stdout);
    return fd;
}

/* Where packets come from: a bound socket, or the first connection to it. */
static int open_door(int type)
{
    int fd = open_socket(type, 0), on = 1;
    if (type == SOCK_STREAM) {
        if ((fd = accept(fd, NULL, NULL)) < 0)
            exit(0);
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    }
    return fd;
}

static void echo(int type, size_t packet, size_t answer)
{
    int fd = open_door(type);
    struct sockaddr_in from;
    socklen_t size = sizeof from;
    while (recvfrom(fd, bytes, packet, MSG_WAITALL, (struct sockaddr *)&from, &size) == (ssize_t)packet)
        sendto(fd, bytes, answer, MSG_NOSIGNAL, type == SOCK_DGRAM ? (struct sockaddr *)&from : NULL, size);
}

static void send_all(int fd, size_t packet, size_t answer, double period, uint64_t count)
{
    double beat = now_s() + period;
    uint64_t sent = 0, answered = 0;
    while (!ended && answered < count) {
        double wait = sent < count ? beat - now_s() : 1.0;
        struct timespec until = {(time_t)wait, (long)((wait - (double)(time_t)wait) * 1e9)};
        struct pollfd ready = {.fd = fd, .events = POLLIN};
        if (wait <= 0) {
            memcpy(bytes, &sent, sizeof sent);
            stamp(PACKET, packet);
            if (send(fd, bytes, packet, MSG_NOSIGNAL) != (ssize_t)packet)
                return;
            sent++;
            beat += period;
        } else if (ppoll(&ready, 1, &until, NULL) > 0) {
            if (recv(fd, bytes, answer, MSG_WAITALL) != (ssize_t)answer)
                return;
            stamp(ANSWER, answer);
            answered++;
        } else if (sent == count)
            return;
    }
}

static void pass(int type, int robot, int client)
{
    struct sockaddr_in from = {0};
    struct pollfd ready[2] = {{.fd = robot, .events = POLLIN}, {.fd = client, .events = POLLIN}};
    while (!ended && (poll(ready, 2, -1) > 0 || errno == EINTR)) {
        for (int way = PACKET; way <= ANSWER && !ended; way++) {
            socklen_t length = sizeof from;
            struct sockaddr *whence = way == PACKET && type == SOCK_DGRAM ? (struct sockaddr *)&from : NULL;
            if (!ready[way].revents)
                continue;
            ssize_t size = recvfrom(ready[way].fd, bytes, LARGEST, MSG_DONTWAIT, whence, whence ? &length : NULL);
            if (size < 0 && (errno == ECONNREFUSED || errno == EAGAIN))
                continue; /* the other side is not there yet, or no more */
            if (size <= 0)
                return;
            stamp((uint32_t)way, (size_t)size);
            if (way == ANSWER && type == SOCK_DGRAM)
                sendto(robot, bytes, (size_t)size, 0, (struct sockaddr *)&from, sizeof from);
            else
                send(ready[1 - way].fd, bytes, (size_t)size, MSG_NOSIGNAL);
        }
    }
}

int main(int argc, char **argv)
{
    if (argc < 5) {
        fprintf(stderr, "usage: relay echo|send|pass tcp|udp …, see its source\n");
        return 2;
    }
    struct sigaction ending = {.sa_handler = end};
    sigaction(SIGTERM, &ending, NULL);
    int type = strcmp(argv[2], "tcp") ? SOCK_DGRAM : SOCK_STREAM, port = atoi(argv[3]);
    if (!strcmp(argv[1], "echo")) {
        echo(type, (size_t)port, (size_t)atoi(argv[4]));
        return 0;
    }
    if (!(kept = malloc(ROOM)))
        fail("memory");
    if (!strcmp(argv[1], "send") && argc == 9)
        send_all(open_socket(type, port), (size_t)atoi(argv[5]), (size_t)atoi(argv[6]), atof(argv[7]) * 1e-9,
                 (uint64_t)atoll(argv[8]));
    else {
        int door = open_door(type), beyond = open_socket(type, port);
        pass(type, type == SOCK_STREAM ? beyond : door, type == SOCK_STREAM ? door : beyond);
    }
    FILE *file = fopen(argv[4], "wb");
    if (!file || fwrite(kept, 1, filled, file) != filled || fclose(file))
        fail(argv[4]);
    return 0;
}
