/* The messages of one control cycle over the robot's and the sensor's wire, as fast as a program can say them.
 *
 * host ROBOT SENSOR STATUS_BLOCK MOVE_BLOCK ANSWER_BYTES MOVE_ANSWER_BYTES
 *
 * A wire is tcp:ADDRESS:PORT, pty:DEVICE or (the sensor's) can:INTERFACE; blocks are hexadecimal. The program says
 * its next message when as many bytes have come as it waits for, and throws the bytes away. It ends with the wire.
 */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

enum { ENQ = 0x05, ACK = 0x06, EOT = 0x04, STEPS = 10, LARGEST = 256 };

struct step {
    unsigned char bytes[LARGEST];
    size_t size;
    size_t awaited;
};

static void fail(const char *what)
{
    fprintf(stderr, "host: %s: %s\n", what, strerror(errno));
    exit(1);
}

static int open_tcp(char *address)
{
    char *colon = strrchr(address, ':');
    if (!colon) {
        errno = EINVAL;
        fail(address);
    }
    *colon = 0;
    struct sockaddr_in peer = {.sin_family = AF_INET, .sin_port = htons((unsigned short)atoi(colon + 1))};
    if (inet_pton(AF_INET, address, &peer.sin_addr) != 1)
        fail(address);
    int fd = socket(AF_INET, SOCK_STREAM, 0);
    if (fd < 0 || connect(fd, (struct sockaddr *)&peer, sizeof peer) < 0)
        fail(address);
    int on = 1;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return fd;
}

static int open_pty(const char *device)
{
    int fd = open(device, O_RDWR | O_NOCTTY);
    struct termios settings;
    if (fd < 0 || tcgetattr(fd, &settings) < 0)
        fail(device);
    cfmakeraw(&settings);
    if (tcsetattr(fd, TCSANOW, &settings) < 0)
        fail(device);
    return fd;
}

static int open_can(const char *interface)
{
    int fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    struct sockaddr_can here = {.can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(interface)};
    if (fd < 0 || bind(fd, (struct sockaddr *)&here, sizeof here) < 0)
        fail(interface);
    return fd;
}

static int open_wire(char *url)
{
    char *target = strchr(url, ':');
    if (!target) {
        errno = EINVAL;
        fail(url);
    }
    target++;
    if (!strncmp(url, "tcp:", 4))
        return open_tcp(target);
    if (!strncmp(url, "pty:", 4))
        return open_pty(target);
    return open_can(target);
}

static struct step say_byte(unsigned char byte, size_t awaited)
{
    struct step step = {.size = 1, .awaited = awaited};
    step.bytes[0] = byte;
    return step;
}

static struct step say_hex(const char *hex, size_t awaited)
{
    struct step step = {.awaited = awaited};
    unsigned value;
    for (; step.size < LARGEST && sscanf(hex, "%2x", &value) == 1; hex += 2)
        step.bytes[step.size++] = (unsigned char)value;
    return step;
}

int main(int argc, char **argv)
{
    if (argc != 7) {
        fprintf(stderr, "usage: host ROBOT SENSOR STATUS_BLOCK MOVE_BLOCK ANSWER_BYTES MOVE_ANSWER_BYTES\n");
        return 2;
    }
    int robot = open_wire(argv[1]), sensor = open_wire(argv[2]);
    struct step steps[STEPS] = {
        say_byte(ENQ, 1), say_hex(argv[3], 1), say_byte(EOT, 1),
        say_byte(ACK, (size_t)atoi(argv[5])), say_byte(ACK, 1),
        say_byte(ENQ, 1), say_hex(argv[4], 1), say_byte(EOT, 1),
        say_byte(ACK, (size_t)atoi(argv[6])), say_byte(ACK, 1),
    };
    int poll = epoll_create1(0);
    struct epoll_event robot_in = {.events = EPOLLIN, .data.fd = robot};
    struct epoll_event sensor_in = {.events = EPOLLIN, .data.fd = sensor};
    if (poll < 0 || epoll_ctl(poll, EPOLL_CTL_ADD, robot, &robot_in) < 0 ||
        epoll_ctl(poll, EPOLL_CTL_ADD, sensor, &sensor_in) < 0)
        fail("epoll");

    unsigned char in[4096];
    for (int k = 0;; k = (k + 1) % STEPS) {
        if (write(robot, steps[k].bytes, steps[k].size) != (ssize_t)steps[k].size)
            return 0;
        size_t got = 0;
        while (got < steps[k].awaited) {
            struct epoll_event ready[2];
            int count = epoll_wait(poll, ready, 2, -1);
            for (int j = 0; j < count; j++) {
                ssize_t size = read(ready[j].data.fd, in, sizeof in);
                if (size <= 0)
                    return 0;
                if (ready[j].data.fd == robot)
                    got += (size_t)size;
            }
        }
    }
}
