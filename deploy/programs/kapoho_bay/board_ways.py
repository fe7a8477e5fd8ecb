"""Other ways to ask NxSDK and the chips, in the order of what is likeliest to fail; see docs/own_board.md."""

from ways import OtherWay

FIRST = "one neuron"

WAYS = [
    OtherWay("count-words", "packets", "channel.write and read count words, not messages", (FIRST,)),
    OtherWay("one-word", "packets", "messages have one word, 64 for a packet", (FIRST,)),
    OtherWay("fields", "states", "U and V of a state are written each by itself, not as a CxState", (FIRST, "reset")),
    OtherWay("whole-cores", "states", "states are cleared by nx_fast_init64, a whole core at a time", (FIRST, "reset")),
    OtherWay("phases", "phases", "phases of compartments are set again where states are cleared", ("reset",)),
    OtherWay("compression-3", "rows", "rows with indices have compression 3, not 0", (FIRST, "one axon", "weights")),
    OtherWay(
        "masks", "tables", "the table of input axons is a bit an input and core, a tenth of the size", ("tables",)
    ),
]
