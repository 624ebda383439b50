/* FMI 2.0 for co-simulation around the functions of a damper model; model.h names them.
 *
 * Inputs u (m), v (m/s), a (m/s^2), current (A); outputs force (N), beyond (of the inputs set last). The force is that of the inputs set last. A step
 * takes the inputs as they are at its beginning: what is read after it is the force there, until new inputs are set.
 */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include "model.h"

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef void (*fmi2CallbackLogger)(
    fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
typedef void *(*fmi2CallbackAllocateMemory)(size_t, size_t);
typedef void (*fmi2CallbackFreeMemory)(void *);
typedef void (*fmi2StepFinished)(fmi2ComponentEnvironment, fmi2Status);
typedef struct {
    fmi2CallbackLogger logger;
    fmi2CallbackAllocateMemory allocateMemory;
    fmi2CallbackFreeMemory freeMemory;
    fmi2StepFinished stepFinished;
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

enum { INPUTS = 4, FORCE = 4, FIRST_CONSTANT = 5 };

typedef struct {
    double input[INPUTS];
    double before[MEMORY]; /* the model's memory at the sample before this one */
    double now[MEMORY];    /* at this sample, once it is evaluated */
    double force;
    double elapsed;        /* from the sample before to this one, s */
    double time;
    int begun;             /* a sample lies before this one */
    int set;               /* inputs were set since this sample was reached */
    int evaluated;
} Damper;

static void evaluate(Damper *damper) {
    const double *x = damper->input;
    if (damper->evaluated) {
        return;
    }
    memcpy(damper->now, damper->before, sizeof damper->now);
    damper->force = damper->begun ? model_step(damper->now, x[0], x[1], x[2], x[3], damper->elapsed)
                                  : model_start(damper->now, x[0], x[1], x[2], x[3]);
    damper->evaluated = 1;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)resources, (void)functions, (void)visible, (void)logging;
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, GUID) != 0) {
        return NULL;
    }
    return calloc(1, sizeof(Damper));
}

EXPORT void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean ends, fmi2Real stop) {
    (void)given, (void)tolerance, (void)ends, (void)stop;
    ((Damper *)c)->time = start;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Reset(fmi2Component c) { memset(c, 0, sizeof(Damper)); return fmi2OK; }

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Damper *damper = c;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] < INPUTS) {
            value[k] = damper->input[vr[k]];
        } else if (vr[k] == FORCE) {
            if (damper->set || !damper->begun) {
                evaluate(damper);
            }
            value[k] = damper->force;
        } else if (vr[k] - FIRST_CONSTANT < sizeof constants / sizeof constants[0]) {
            value[k] = constants[vr[k] - FIRST_CONSTANT];
        } else if (vr[k] - FIRST_CONSTANT == sizeof constants / sizeof constants[0]) {
            value[k] = model_beyond(damper->input[0], damper->input[1], damper->input[3], NAN);
        } else {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Damper *damper = c;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] >= INPUTS) {
            return fmi2Error;
        }
        damper->input[vr[k]] = value[k];
        damper->set = 1;
        damper->evaluated = 0;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real at, fmi2Real size, fmi2Boolean settled) {
    Damper *damper = c;
    (void)settled;
    if (!(size > 0.0)) {
        return size == 0.0 ? fmi2OK : fmi2Error;
    }
    evaluate(damper);
    memcpy(damper->before, damper->now, sizeof damper->before);
    damper->begun = 1;
    damper->elapsed = size;
    damper->time = at + size;
    damper->set = 0;
    damper->evaluated = 0;
    return damper->force == damper->force ? fmi2OK : fmi2Error; /* not a number: nor are the inputs */
}

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (*state == NULL && (*state = malloc(sizeof(Damper))) == NULL) {
        return fmi2Error;
    }
    memcpy(*state, c, sizeof(Damper));
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(c, state, sizeof(Damper));
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(Damper);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    (void)c;
    if (size < sizeof(Damper)) {
        return fmi2Error;
    }
    memcpy(bytes, state, sizeof(Damper));
    return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof(Damper) || fmi2GetFMUstate(c, state) != fmi2OK) {
        return fmi2Error;
    }
    memcpy(*state, bytes, sizeof(Damper));
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = ((Damper *)c)->time;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)c;
    *value = 0;
    return kind == fmi2Terminated ? fmi2OK : fmi2Discard;
}

/* What this model has none of. */
EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}
EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}
EXPORT fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}
EXPORT fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}
EXPORT fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}
EXPORT fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
    (void)c, (void)vr, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}
EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference of[], size_t n_of,
                                               const fmi2ValueReference by[], size_t n_by, const fmi2Real seed[],
                                               fmi2Real value[]) {
    (void)c, (void)of, (void)n_of, (void)by, (void)n_by, (void)seed, (void)value;
    return fmi2Error;
}
EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                              const fmi2Integer order[], const fmi2Real value[]) {
    (void)c, (void)vr, (void)order, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}
EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                               const fmi2Integer order[], fmi2Real value[]) {
    (void)c, (void)vr, (void)order, (void)value;
    return n == 0 ? fmi2OK : fmi2Error;
}
EXPORT fmi2Status fmi2CancelStep(fmi2Component c) { (void)c; return fmi2Error; }
EXPORT fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
