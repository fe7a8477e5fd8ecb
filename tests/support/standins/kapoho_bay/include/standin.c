/* The memory of a chip's cores, and NxSDK's functions as calls into the stand-in. */
#include "nxsdk.h"

#define CORES 256

static NeuronCore cores[CORES];

static int (*channel_id)(const char *);
static void (*read_messages)(int, void *, int), (*write_messages)(int, const void *, int);
static void (*send_spike)(int, int, int), (*touch)(int), (*flush)(int);

void standin_install(int (*a)(const char *), void (*b)(int, void *, int), void (*c)(int, const void *, int),
                     void (*d)(int, int, int), void (*e)(int), void (*f)(int))
{
    channel_id = a;
    read_messages = b;
    write_messages = c;
    send_spike = d;
    touch = e;
    flush = f;
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
