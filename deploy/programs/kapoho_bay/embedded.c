/* Runs on the embedded processor of a Loihi 1 chip, after the neurons of every step (NxSDK's EMBEDDED_MGMT).
 *
 * It brings input to this chip, reads the counts of its excitatory neurons once a query and sets it to rest between two.
 * Beside every excitatory neuron stands a compartment, its counter, which nothing makes spike or decay: each spike of the
 * neuron adds LV_COUNTER_UNIT to its membrane.
 * The host program writes the header beside it, with the tables and numbers of one chip, and is its only partner.
 *
 * One run of the board is: a step of preparation, STEPS + SILENT steps for each query, and a last step in which nothing
 * happens (NxSDK may lose what a chip sends in the very last step of a run). Who says what, and when:
 *
 *   preparation       host: BEGIN; chip: READY; then what comes before a query
 *   before a query    host: SET x SET_BLOCKS (bias and membrane of each input compartment); only with BIAS_INPUT
 *                     host: BIAS x BIAS_BLOCKS (bias of each excitatory neuron); only with ADAPTED
 *   step of a query   host: SPIKES (inputs that spike in this step), for each of STEPS steps; only without BIAS_INPUT
 *   end of a query    chip: COUNTS x COUNT_BLOCKS
 *
 * That order never depends on what a packet holds, so neither side can wait for the other where the other waits, too.
 * Every packet carries run, query, number and a checksum. One that is not the one expected makes this query void: from
 * then on packets are read but not used, and at its end the host gets FAULT packets in place of READY or COUNTS. Counts
 * are never sent after a fault, so a lost or misplaced packet cannot turn into wrong numbers or zeros.
 *
 * What no public program shows in just this form has another in the same place, behind #if: the host program's --ways.
 *
 * All names of this file begin with lv_, as NxSDK's header, which is not public, may have any other.
 */

#include <stdint.h>
#include <string.h>

#define LV_EMBEDDED_TABLES
#include "embedded.h"

#define LV_MAGIC 0x4c560100 /* protocol 1; the low byte is the kind */
enum { LV_BEGIN = 1, LV_SPIKES, LV_SET, LV_READY, LV_COUNTS, LV_FAULT, LV_BIAS };

/* Words of a packet. */
enum { LV_KIND, LV_RUN, LV_QUERY, LV_NUMBER, LV_LENGTH, LV_FIRST, LV_SECOND, LV_SUM, LV_PAYLOAD, LV_WORDS = 64 };
#define LV_ROOM (LV_WORDS - LV_PAYLOAD)
#define LV_BLOCKS(n, each) (((n) + (each) - 1) / (each))
#define LV_AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1) /* C has no empty arrays */

#define LV_COUNT_BLOCKS LV_AT_LEAST_ONE(LV_BLOCKS(LV_EXC, LV_ROOM)) /* a chip without exc reports, too */
#define LV_SET_BLOCKS LV_BLOCKS(LV_SOURCES, LV_ROOM / 2)
#define LV_BIAS_BLOCKS (LV_ADAPTED ? LV_BLOCKS(LV_EXC, LV_ROOM) : 0)
#define LV_PRESENTATION (LV_STEPS + LV_SILENT)

#define LV_NO_AXON 0xffff

/* What was wrong with a packet, or with a counter; the host has the same list. */
enum {
    LV_SOUND,
    LV_BAD_SUM,
    LV_BAD_KIND,
    LV_BAD_RUN,
    LV_BAD_QUERY,
    LV_BAD_NUMBER,
    LV_BAD_LENGTH,
    LV_BAD_VALUE,
    LV_BAD_BUNDLE,
    LV_BAD_COUNT
};

enum { LV_BEFORE_RUN, LV_IN_QUERY, LV_AFTER_RUN };

static int lv_state = LV_BEFORE_RUN;
static int lv_to_chip, lv_from_chip; /* channels */
static int32_t lv_packet[LV_WORDS];
static int32_t lv_run, lv_query; /* as the host numbers them */
static int32_t lv_left, lv_step; /* queries of this run that are left, step of this query */
static int32_t lv_fault, lv_fault_step, lv_fault_expected, lv_fault_found;
static int32_t lv_received; /* spikes or settings taken over in this query */
static int32_t lv_counts[LV_AT_LEAST_ONE(LV_EXC)];

static NeuronCore *lv_neuron_core(int id) { return NEURON_PTR(((CoreId){.id = (uint16_t)id})); }

/* A weighted sum; odd weights, so that no change of a single word goes unseen. Words beyond the length are 0, which add
 * nothing, so they are not looked at. */
static int32_t lv_checksum(const int32_t *words)
{
    uint32_t sum = 0;
    uint32_t used = words[LV_LENGTH] < 0 || words[LV_LENGTH] > LV_ROOM ? LV_ROOM : (uint32_t)words[LV_LENGTH];
    for (uint32_t i = 0; i < LV_PAYLOAD + used; i++) {
        if (i != LV_SUM) {
            sum += (uint32_t)words[i] * (2 * i + 1);
        }
    }
    return (int32_t)sum;
}

/* Only the first fault of a query is told: what follows from it says nothing. */
static void lv_note(int32_t kind, int32_t expected, int32_t found)
{
    if (lv_fault == LV_SOUND) {
        lv_fault = kind;
        lv_fault_step = lv_step;
        lv_fault_expected = expected;
        lv_fault_found = found;
    }
}

static int lv_same(int32_t kind, int32_t expected, int32_t found)
{
    if (expected != found) {
        lv_note(kind, expected, found);
    }
    return expected == found;
}

/* Wait for the next packet; whether it is the expected one and this query is still sound. The run is known by BEGIN. */
static int lv_take(int32_t kind, int32_t number, int32_t longest)
{
    readChannel(lv_to_chip, lv_packet, LV_MESSAGES);
    if (lv_fault != LV_SOUND || !lv_same(LV_BAD_SUM, lv_checksum(lv_packet), lv_packet[LV_SUM]) ||
        !lv_same(LV_BAD_KIND, LV_MAGIC + kind, lv_packet[LV_KIND]) ||
        (kind != LV_BEGIN && !lv_same(LV_BAD_RUN, lv_run, lv_packet[LV_RUN])) ||
        !lv_same(LV_BAD_QUERY, lv_query, lv_packet[LV_QUERY]) ||
        !lv_same(LV_BAD_NUMBER, number, lv_packet[LV_NUMBER])) {
        return 0;
    }
    if (lv_packet[LV_LENGTH] < 0 || lv_packet[LV_LENGTH] > longest) {
        lv_note(LV_BAD_LENGTH, longest, lv_packet[LV_LENGTH]);
    }
    return lv_fault == LV_SOUND;
}

static void lv_give(int32_t kind, int32_t number, int32_t length)
{
    lv_packet[LV_KIND] = LV_MAGIC + kind;
    lv_packet[LV_RUN] = lv_run;
    lv_packet[LV_QUERY] = lv_query;
    lv_packet[LV_NUMBER] = number;
    lv_packet[LV_LENGTH] = length;
    lv_packet[LV_SUM] = lv_checksum(lv_packet);
    writeChannel(lv_from_chip, lv_packet, LV_MESSAGES);
}

static void lv_empty_packet(void)
{
    for (int i = 0; i < LV_WORDS; i++) {
        lv_packet[i] = 0;
    }
}

static void lv_give_fault(int32_t number)
{
    lv_empty_packet();
    lv_packet[LV_PAYLOAD] = lv_fault;
    lv_packet[LV_PAYLOAD + 1] = lv_fault_step;
    lv_packet[LV_PAYLOAD + 2] = lv_fault_expected;
    lv_packet[LV_PAYLOAD + 3] = lv_fault_found;
    lv_give(LV_FAULT, number, 4);
}

/* What the counters hold after the last silent step: the last spike that input can cause has reached them by then. A
 * membrane that is no whole number of spikes, or more than one a step, is a fault. */
static void lv_collect(void)
{
    for (int i = 0; i < LV_EXC; i++) {
        int32_t held = lv_neuron_core(lv_counter_places[i].core)->cx_state[lv_counter_places[i].compartment].V;
        lv_counts[i] = held / LV_COUNTER_UNIT;
        if (held < 0 || held % LV_COUNTER_UNIT != 0 || lv_counts[i] > LV_PRESENTATION) {
            lv_note(LV_BAD_COUNT, LV_COUNTER_UNIT, held);
        }
    }
}

/* A core's registers that were written must be read before the next step, or the core may stall. */
static void lv_flush_exc(void)
{
    for (int i = 0; i < LV_EXC_CORES; i++) {
        nx_flush_core((CoreId){.id = lv_exc_cores[i]});
    }
}

static void lv_flush_sources(void)
{
    for (int i = 0; i < LV_SOURCE_CORES; i++) {
        nx_flush_core((CoreId){.id = lv_source_cores[i]});
    }
}

static void lv_set_state(int core, int compartment, int32_t membrane)
{
    NeuronCore *own = lv_neuron_core(core);
#if LV_FIELDS /* the way "fields" */
    own->cx_state[compartment].U = 0;
    own->cx_state[compartment].V = membrane;
#else
    own->cx_state[compartment] = (CxState){.U = 0, .V = membrane};
#endif
}

/* Membranes of neurons and counters to 0, which stand on the same cores; currents have no memory; inhibitory neurons and
 * relays are at 0 by the last silent step. */
static void lv_clear(void)
{
#if LV_WHOLE_CORES /* the way "whole-cores": as pelenet's reset.c; what else stands there is at 0, or is set after */
    for (int i = 0; i < LV_EXC_CORES; i++) {
        nx_fast_init64(lv_neuron_core(lv_exc_cores[i])->cx_state, LV_COMPARTMENTS, 0);
    }
#else
    for (int i = 0; i < LV_EXC; i++) {
        lv_set_state(lv_exc_places[i].core, lv_exc_places[i].compartment, 0);
        lv_set_state(lv_counter_places[i].core, lv_counter_places[i].compartment, 0);
    }
#endif
#if LV_PHASES /* the way "phases": as there, too */
    MetaState idle = {.Phase0 = 2, .SomaOp0 = 3, .Phase1 = 2, .SomaOp1 = 3,
                      .Phase2 = 2, .SomaOp2 = 3, .Phase3 = 2, .SomaOp3 = 3};
    uint32_t word;
    memcpy(&word, &idle, sizeof word);
    for (int i = 0; i < LV_EXC_CORES; i++) {
        nx_fast_init32(lv_neuron_core(lv_exc_cores[i])->cx_meta_state, LV_COMPARTMENTS / 4, word);
    }
#endif
    lv_flush_exc();
}

/* The bias of one input compartment: mantissa (12 bits) and exponent in a word. */
static void lv_set_bias(int i, int32_t bias)
{
    NeuronCore *core = lv_neuron_core(lv_source_places[i].core);
    CxCfg settings = core->cx_cfg[lv_source_places[i].compartment]; /* read first: it also names the profiles */
    settings.Bias = bias & 0xfff;
    settings.BiasExp = bias >> 12;
    core->cx_cfg[lv_source_places[i].compartment] = settings;
}

/* Without a bias an input compartment's membrane stays where it is, not above its threshold: it cannot spike. */
static void lv_silence(void)
{
    for (int i = 0; i < LV_SOURCES; i++) {
        lv_set_bias(i, 0);
    }
    lv_flush_sources();
}

/* One input compartment: a word with its bias, and one with the membrane. */
static void lv_set_source(int i, const int32_t *words)
{
    lv_set_bias(i, words[0]);
    lv_set_state(lv_source_places[i].core, lv_source_places[i].compartment, words[1]);
}

/* The biases of this query's excitatory neurons: mantissa (12 bits and sign) and exponent (3 bits) in a word. */
static void lv_take_biases(void)
{
    for (int block = 0; block < LV_BIAS_BLOCKS; block++) {
        int first = block * LV_ROOM;
        int here = LV_EXC - first < LV_ROOM ? LV_EXC - first : LV_ROOM;
        if (!lv_take(LV_BIAS, block, LV_ROOM) || !lv_same(LV_BAD_LENGTH, here, lv_packet[LV_LENGTH])) {
            continue;
        }
        for (int i = 0; i < here; i++) {
            NeuronCore *core = lv_neuron_core(lv_exc_places[first + i].core);
            CxCfg own = core->cx_cfg[lv_exc_places[first + i].compartment]; /* it also names the profiles */
            own.BiasExp = lv_packet[LV_PAYLOAD + i] & 7;
            own.Bias = (lv_packet[LV_PAYLOAD + i] - own.BiasExp) / 8;
            core->cx_cfg[lv_exc_places[first + i].compartment] = own;
        }
        lv_received += here;
    }
    if (LV_ADAPTED) {
        lv_flush_exc();
    }
}

/* Make ready for the query that begins with the next step. */
static void lv_set_up(void)
{
    lv_step = 0;
    lv_fault = LV_SOUND;
    lv_received = 0;
    for (int block = 0; block < LV_SET_BLOCKS; block++) {
        int first = block * (LV_ROOM / 2);
        int here = LV_SOURCES - first < LV_ROOM / 2 ? LV_SOURCES - first : LV_ROOM / 2;
        if (lv_take(LV_SET, block, LV_ROOM) && lv_same(LV_BAD_LENGTH, 2 * here, lv_packet[LV_LENGTH])) {
            for (int i = 0; i < here; i++) {
                lv_set_source(first + i, lv_packet + LV_PAYLOAD + 2 * i);
            }
            lv_received += here;
        }
    }
    lv_flush_sources(); /* inputs that were not set have no bias: they stay silent */
    lv_take_biases();
}

/* The input axon of a target core that an input's spikes go to, or LV_NO_AXON. */
static uint16_t lv_axon(int input, int target)
{
#if LV_MASKS /* the way "masks": a bit an input; an input's axon is behind those of the inputs before it */
    uint32_t mask = lv_target_masks[target][input / 32], before = mask & ((1u << input % 32) - 1);
    uint16_t axon = lv_target_firsts[target][input / 32];
    for (; before != 0; before &= before - 1) {
        axon++;
    }
    return mask >> input % 32 & 1 ? axon : LV_NO_AXON;
#else
    return lv_target_axons[input][target];
#endif
}

/* Spikes of this step, to every core of this chip with a synapse or the relay of the input. They are felt in the next
 * step. */
static void lv_inject(runState *s)
{
    if (!lv_take(LV_SPIKES, lv_step, LV_HOST_SPIKES)) {
        return;
    }
    for (int i = 0; i < lv_packet[LV_LENGTH]; i++) {
        int32_t input = lv_packet[LV_PAYLOAD + i];
        if (input < 0 || input >= LV_INPUTS) {
            lv_note(LV_BAD_VALUE, LV_INPUTS, input);
            return;
        }
        for (int core = 0; core < LV_TARGET_CORES; core++) {
            uint16_t axon = lv_axon(input, core);
            if (axon != LV_NO_AXON) {
                nx_send_discrete_spike((uint16_t)s->time_step, (CoreId){.id = lv_target_cores[core]}, axon);
            }
        }
        lv_received++;
    }
}

static void lv_report(void)
{
    for (int block = 0; block < LV_COUNT_BLOCKS; block++) {
        int first = block * LV_ROOM;
        int here = LV_EXC - first < LV_ROOM ? LV_EXC - first : LV_ROOM;
        if (lv_fault != LV_SOUND) {
            lv_give_fault(block);
            continue;
        }
        lv_empty_packet();
        lv_packet[LV_FIRST] = lv_step;
        lv_packet[LV_SECOND] = lv_received;
        for (int i = 0; i < here; i++) {
            lv_packet[LV_PAYLOAD + i] = lv_counts[first + i];
        }
        lv_give(LV_COUNTS, block, here);
    }
}

static void lv_begin_run(void)
{
    lv_to_chip = getChannelID(LV_TO_CHIP);
    lv_from_chip = getChannelID(LV_FROM_CHIP);
    lv_step = lv_query = lv_run = lv_left = 0;
    lv_fault = LV_SOUND;
    if (lv_take(LV_BEGIN, 0, 1) && lv_same(LV_BAD_BUNDLE, LV_FINGERPRINT, lv_packet[LV_PAYLOAD])) {
        lv_run = lv_packet[LV_RUN];
        lv_query = lv_packet[LV_SECOND];
        lv_left = lv_packet[LV_FIRST];
    }
#if LV_BALLAST /* a rung loads tables as large as the bundle's: they must be there */
    lv_same(LV_BAD_BUNDLE, LV_FINGERPRINT & 0x7fff, lv_ballast[LV_BALLAST - 1]);
#endif
    if (lv_fault != LV_SOUND) {
        lv_left = 0;
        lv_give_fault(0);
    } else {
        lv_clear(); /* spikes from before this run are nobody's */
        lv_empty_packet();
        lv_packet[LV_FIRST] = LV_EXC;
        lv_packet[LV_SECOND] = LV_SOURCES;
        lv_give(LV_READY, 0, 0);
    }
    if (lv_left > 0) {
        lv_set_up();
    }
    lv_state = lv_left > 0 ? LV_IN_QUERY : LV_AFTER_RUN;
}

static void lv_present(runState *s)
{
    if (!LV_BIAS_INPUT && lv_step < LV_STEPS) {
        lv_inject(s);
    }
    if (LV_BIAS_INPUT && lv_step == LV_STEPS - 1) {
        lv_silence();
    }
    if (++lv_step < LV_PRESENTATION) {
        return;
    }
    lv_collect();
    lv_report();
    lv_clear();
    lv_query++;
    if (--lv_left > 0) {
        lv_set_up();
    } else {
        lv_state = LV_AFTER_RUN;
    }
}

int lava_vpr_guard(runState *s)
{
    (void)s;
    return 1;
}

void lava_vpr_manage(runState *s)
{
    if (lv_state == LV_BEFORE_RUN) {
        lv_begin_run();
    } else if (lv_state == LV_IN_QUERY) {
        lv_present(s);
    } else {
        lv_state = LV_BEFORE_RUN;
    }
}
