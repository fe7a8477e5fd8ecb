/* What embedded.c needs of NxSDK's header, for tests; registers are plain integers whose ranges the stand-in checks. */
#ifndef NXSDK_H
#define NXSDK_H

#include <stdint.h>

typedef struct { uint16_t id; } CoreId;
typedef struct { int32_t time_step, total_steps; } runState;

#ifdef STANDIN_NO_TYPE
#define CxState CxStateRegister
typedef struct { int32_t U, V; } CxState;
#undef CxState
#define STATE CxStateRegister
#else
typedef struct { int32_t U, V; } CxState;
#define STATE CxState
#endif
typedef struct {
    uint32_t Phase0 : 4, SomaOp0 : 4, Phase1 : 4, SomaOp1 : 4, Phase2 : 4, SomaOp2 : 4, Phase3 : 4, SomaOp3 : 4;
} MetaState;
typedef struct { int32_t Bias, BiasExp, VthProfile, CxProfile; } CxCfg;

typedef struct {
    STATE cx_state[1024];
    CxCfg cx_cfg[1024];
    uint32_t cx_meta_state[256];
    int32_t standin_stands[1024]; /* compartments that no step changes */
} NeuronCore;

NeuronCore *standin_neuron_core(CoreId core);
#define NEURON_PTR(core) standin_neuron_core(core)

int getChannelID(const char *name);
void readChannel(int channel, void *messages, int n);
void writeChannel(int channel, const void *messages, int n);
void nx_send_discrete_spike(uint16_t time, CoreId core, uint16_t axon);
void nx_flush_core(CoreId core);
void nx_fast_init64(void *registers, int n, uint64_t value);
void nx_fast_init32(void *registers, int n, uint32_t value);

#endif
