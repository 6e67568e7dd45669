/* Functions that hosts look for in a library, and that nobody calls in the benchmark.  FMI's own declarations are left
   out: these take no arguments. */
#define REFUSED(name)                                                                                                  \
    int fmi2##name(void)                                                                                               \
    {                                                                                                                  \
        return 3; /* fmi2Error */                                                                                      \
    }

REFUSED(GetTypesPlatform)
REFUSED(GetVersion)
REFUSED(SetDebugLogging)
REFUSED(Reset)
REFUSED(GetString)
REFUSED(SetString)
REFUSED(GetFMUstate)
REFUSED(SetFMUstate)
REFUSED(FreeFMUstate)
REFUSED(SerializedFMUstateSize)
REFUSED(SerializeFMUstate)
REFUSED(DeSerializeFMUstate)
REFUSED(GetDirectionalDerivative)
REFUSED(SetRealInputDerivatives)
REFUSED(GetRealOutputDerivatives)
REFUSED(CancelStep)
REFUSED(GetStatus)
REFUSED(GetRealStatus)
REFUSED(GetIntegerStatus)
REFUSED(GetBooleanStatus)
REFUSED(GetStringStatus)
