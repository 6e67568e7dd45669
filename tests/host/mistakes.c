#include "mistakes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
#define PLACE(name) name##_place,
    FUNCTIONS(PLACE)
#undef PLACE
    N_FUNCTIONS
};

static long made[N_FUNCTIONS];

#define COUNTED(name, ...) (made[name##_place]++, f->name(__VA_ARGS__))
#define REFUSED(name, ...) EXPECT(COUNTED(name, __VA_ARGS__) == fmi2Error)
#define DISCARDED(name, ...) EXPECT(COUNTED(name, __VA_ARGS__) == fmi2Discard)

static const fmi2ValueReference bad = 999999, huge = 0xffffffffu;
static const size_t many = (size_t)1 << 60;

static void get_and_set(const Fmu *f, fmi2Component c)
{
    double nan = NAN, out;
    int number = 1;
    const char *invalid = "\xff\xfe", *odd = "100%n%s", *null = NULL, *text = NULL;
    REFUSED(GetReal, c, &bad, 1, &out);
    REFUSED(GetReal, c, &huge, 1, &out);
    REFUSED(GetReal, c, NULL, 1, &out);
    REFUSED(GetReal, c, f->outputs, many, &out);
    REFUSED(GetInteger, c, &bad, 1, &number);
    REFUSED(GetInteger, c, f->outputs, 1, &number);
    REFUSED(GetInteger, c, f->outputs, 1, NULL);
    REFUSED(GetBoolean, c, &bad, 1, &number);
    REFUSED(GetBoolean, c, f->outputs, 1, &number);
    REFUSED(GetBoolean, c, f->outputs, many, &number);
    REFUSED(GetString, c, &bad, 1, &text);
    REFUSED(GetString, c, f->outputs, 1, &text);
    REFUSED(SetReal, c, f->outputs, 1, &nan);
    EXPECT(f->n_inputs == 0 || COUNTED(SetReal, c, f->inputs, 1, &nan) == fmi2Error);
    REFUSED(SetInteger, c, &bad, 1, &number);
    REFUSED(SetInteger, c, f->outputs, 1, &number);
    REFUSED(SetBoolean, c, &bad, 1, &number);
    REFUSED(SetBoolean, c, f->outputs, 1, NULL);
    REFUSED(SetString, c, &bad, 1, &invalid);
    REFUSED(SetString, c, &bad, 1, &null);
    REFUSED(SetString, c, &bad, 1, &odd);
}

static void life_cycle(const Fmu *f, fmi2Component c, fmi2Component begun)
{
    EXPECT(COUNTED(Instantiate, "other", fmi2CoSimulation, "another", f->uri, &callbacks, 0, 0) == NULL);
    EXPECT(COUNTED(Instantiate, "other", fmi2ModelExchange, f->guid, f->uri, &callbacks, 0, 0) == NULL);
    EXPECT(COUNTED(Instantiate, NULL, fmi2CoSimulation, f->guid, f->uri, NULL, 0, 1) == NULL);
    COUNTED(FreeInstance, NULL);
    REFUSED(Reset, NULL);
    REFUSED(SetupExperiment, c, 0, 0.0, 0.0, 0, 0.0);
    REFUSED(SetupExperiment, begun, 0, 0.0, NAN, 0, 0.0);
    REFUSED(EnterInitializationMode, c);
    REFUSED(EnterInitializationMode, begun);
    REFUSED(ExitInitializationMode, c);
    REFUSED(ExitInitializationMode, begun);
    REFUSED(DoStep, c, 0.0, -1.0, fmi2True);
    REFUSED(DoStep, c, 1e6, 1.0, fmi2True);
    REFUSED(DoStep, begun, 0.0, 1.0, fmi2True);
    REFUSED(Terminate, NULL);
    REFUSED(Terminate, begun);
}

static void save_and_restore(const Fmu *f, fmi2Component c, fmi2Component begun)
{
    enum { ROOM = 1 << 16 };
    static char bytes[ROOM]; /* so many that it would be seen if they stayed */
    fmi2FMUstate state = NULL, none = NULL, wild = (fmi2FMUstate)bytes;
    size_t size = 0;
    EXPECT(f->GetFMUstate(c, &state) == fmi2OK);
    EXPECT(f->SerializedFMUstateSize(c, state, &size) == fmi2OK && size <= ROOM);
    REFUSED(GetFMUstate, c, NULL);
    REFUSED(GetFMUstate, NULL, &none);
    REFUSED(SetFMUstate, c, NULL);
    REFUSED(SetFMUstate, c, wild);
    REFUSED(SetFMUstate, begun, state); /* is the other one's */
    REFUSED(FreeFMUstate, c, &wild);
    REFUSED(FreeFMUstate, begun, &state);
    REFUSED(SerializedFMUstateSize, c, wild, &size);
    REFUSED(SerializedFMUstateSize, c, state, NULL);
    REFUSED(SerializeFMUstate, c, wild, bytes, ROOM);
    REFUSED(SerializeFMUstate, c, state, bytes, size - 1);
    REFUSED(SerializeFMUstate, c, state, NULL, size);
    EXPECT(f->SerializeFMUstate(c, state, bytes, size) == fmi2OK);
    REFUSED(DeSerializeFMUstate, c, bytes, ROOM, &none);
    bytes[size - 1] ^= 1;
    REFUSED(DeSerializeFMUstate, c, bytes, size, &none);
    REFUSED(DeSerializeFMUstate, c, NULL, size, &none);
    REFUSED(DeSerializeFMUstate, c, bytes, size, NULL);
    EXPECT(none == NULL && f->FreeFMUstate(c, &state) == fmi2OK);
}

static void the_rest(const Fmu *f, fmi2Component c)
{
    const char *category = "logAll", *text = NULL;
    fmi2Status status;
    double value = 1.0;
    int number = 1;
    REFUSED(SetDebugLogging, c, fmi2True, many, &category);
    REFUSED(SetDebugLogging, c, fmi2True, 1, NULL);
    REFUSED(GetDirectionalDerivative, c, f->outputs, 1, f->outputs, 1, &value, &value);
    REFUSED(SetRealInputDerivatives, c, f->outputs, 1, &number, &value);
    REFUSED(GetRealOutputDerivatives, c, f->outputs, 1, &number, &value);
    REFUSED(CancelStep, c);
    DISCARDED(GetStatus, c, fmi2DoStepStatus, &status);
    DISCARDED(GetRealStatus, c, fmi2DoStepStatus, &value);
    DISCARDED(GetRealStatus, c, fmi2LastSuccessfulTime, NULL);
    DISCARDED(GetIntegerStatus, c, fmi2DoStepStatus, &number);
    DISCARDED(GetBooleanStatus, c, fmi2DoStepStatus, &number);
    DISCARDED(GetStringStatus, c, fmi2PendingStatus, &text);
}

void make_mistakes(const Fmu *f, fmi2Component stepping, fmi2Component begun)
{
    get_and_set(f, stepping);
    life_cycle(f, stepping, begun);
    save_and_restore(f, stepping, begun);
    the_rest(f, stepping);
}

long mistakes_made(void)
{
    long n = 0;
    for (int i = 0; i < N_FUNCTIONS; i++) {
        EXPECT(made[i] > 0);
        n += made[i];
    }
    return n;
}
