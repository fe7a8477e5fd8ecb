/* What embedded.c needs of NxSDK's header, for tests; registers are plain integers whose ranges the stand-in checks. */
#ifndef NXSDK_H
#define NXSDK_H

#include <stdint.h>

typedef struct { uint16_t id; } CoreId;
typedef struct { int32_t time_step, total_steps; } runState;

typedef struct { int32_t U, V; } CxState;
typedef struct { int32_t Bias, BiasExp, VthProfile, CxProfile; } CxCfg;

typedef struct {
    CxState cx_state[1024];
    CxCfg cx_cfg[1024];
} NeuronCore;

NeuronCore *standin_neuron_core(CoreId core);
#define NEURON_PTR(core) standin_neuron_core(core)

int getChannelID(const char *name);
void readChannel(int channel, void *messages, int n);
void writeChannel(int channel, const void *messages, int n);
void nx_send_discrete_spike(uint16_t time, CoreId core, uint16_t axon);
void nx_flush_core(CoreId core);

#endif
