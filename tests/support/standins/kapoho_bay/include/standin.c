/* The memory of a chip's cores, and NxSDK's functions as calls into the stand-in. */
#include <string.h>

#include "nxsdk.h"

#define CORES 256

static NeuronCore cores[CORES];

static int (*channel_id)(const char *);
static void (*read_messages)(int, void *, int), (*write_messages)(int, const void *, int);
static void (*send_spike)(int, int, int), (*touch)(int), (*flush)(int), (*whole)(int);

void standin_install(int (*a)(const char *), void (*b)(int, void *, int), void (*c)(int, const void *, int),
                     void (*d)(int, int, int), void (*e)(int), void (*f)(int), void (*g)(int))
{
    channel_id = a;
    read_messages = b;
    write_messages = c;
    send_spike = d;
    touch = e;
    flush = f;
    whole = g;
}

NeuronCore *standin_memory(void) { return cores; }
NeuronCore *standin_neuron_core(CoreId core)
{
    touch(core.id);
    return &cores[core.id % CORES];
}
int getChannelID(const char *name) { return channel_id(name); }
void readChannel(int channel, void *messages, int n) { read_messages(channel, messages, n); }
void writeChannel(int channel, const void *messages, int n) { write_messages(channel, messages, n); }
void nx_send_discrete_spike(uint16_t time, CoreId core, uint16_t axon) { send_spike(time, core.id, axon); }
void nx_flush_core(CoreId core) { flush(core.id); }
void nx_fast_init64(void *registers, int n, uint64_t value)
{
    for (int i = 0; i < n; i++) {
        memcpy((char *)registers + 8 * i, &value, 8);
    }
    whole((int)(((char *)registers - (char *)cores) / (long)sizeof(NeuronCore)));
}
void nx_fast_init32(void *registers, int n, uint32_t value)
{
    for (int i = 0; i < n; i++) {
        memcpy((char *)registers + 4 * i, &value, 4);
    }
}
