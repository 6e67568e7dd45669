/* Steps of instruments: inertial sensors, a line-of-sight sensor, voice coils. */

/* The low-pass of a sensor over a step, in closed form (SensorLowpass of parameters.py): x' = state x + input u. */
INLINE void discretise_lowpass(Lowpass *l, double h)
{
    const double damping = 0.7071067811865476, omega = 6.283185307179586 * l->bandwidth;
    double cosine, sine;
    memset(l->state, 0, sizeof l->state);
    l->input[0] = 1.0, l->input[1] = 0.0;
    if (l->bandwidth == 0.0)
        return;
    if (l->order == 1) {
        l->state[0][0] = exponential(-omega * h);
        l->input[0] = 1.0 - l->state[0][0];
        return;
    }
    const double decay = exponential(-damping * omega * h), share = sqrt(1.0 - damping * damping); /* of omega: of the swing */
    turn_any(share * l->bandwidth * h, &cosine, &sine);
    sine = sine / share;
    l->state[0][0] = decay * (cosine + damping * sine);
    l->state[0][1] = decay * sine;
    l->state[1][0] = decay * -sine;
    l->state[1][1] = decay * (cosine - damping * sine);
    l->input[0] = 1.0 - l->state[0][0];
    l->input[1] = -l->state[1][0];
}

/* Write the names of the sensors that are beyond their ranges. */
INLINE void warn_of_range(const InertialSensors *s, Core *core, const double *readings)
{
    char names[256] = "";
    for (int64_t i = 0; i < SENSORS; i++)
        if (fabs(readings[i]) > s->range[i] && strlen(names) + strlen(s->names[i]) + 3 < sizeof names) {
            strcat(names, *names == '\0' ? "" : ", ");
            strcat(names, s->names[i]);
        }
    write_message(core, MESSAGE_WARNING, "at t = %.9g s %s met the range of its sensor (%g m/s2, %g rad/s; 0 = no limit): "
                  "the estimates are wrong as long as the output saturated is true", core->time + core->step, names,
                  s->ranges[0], s->ranges[1]);
}

/* An element: readings without limits at the end of a step.  `data`: see the class InertialSensors. */
INSTRUCTIONS static int64_t step_inertial(void *arguments, Core *core)
{
    enum { MOTION = 9, TURN = 6 /* the angular velocity among the motion */ };
    InertialSensors *s = arguments;
    double *data = core->data, *x = data + s->states, *readings = data + s->readings, errors[SENSORS] = {0.0};
    const double *u = data + s->motion, *w = u + TURN, h = core->step;
    const double product[] = {w[0] * w[0], w[1] * w[1], w[2] * w[2], w[0] * w[1], w[0] * w[2], w[1] * w[2]};
    if (h != s->step) {
        s->step = h;
        for (int kind = 0; kind < 2; kind++)
            discretise_lowpass(&s->lowpass[kind], h);
    }
    const double interval = s->sample_time > 0.0 ? s->sample_time : h;
    const double elapsed = core->origin + (double)(core->count + 1) * h - data[s->start];
    const int64_t sample = (int64_t)limit(elapsed / interval + 1e-6, s->last_sample);
    for (int kind = 0; kind < 2; kind++) {
        Errors *e = &s->errors[kind];
        if (e->sensors == 0)
            continue;
        ErrorStream *stream = find_stream(e, interval);
        find_errors(e, stream, sample, errors + (kind == 0 ? 0 : SENSORS - 3));
        prepare_drift(e, stream, sample, h / interval);
    }
    bool met = false;
    for (const int64_t *i = s->enabled; i < s->enabled + s->n_enabled; i++) {
        const Lowpass *l = &s->lowpass[*i >= SENSORS - 3];
        const double *row = s->rows + *i * MOTION, *turned = s->products + *i * 6, was = x[*i], rate = x[SENSORS + *i];
        double reading = 0.0;
        for (int j = 0; j < MOTION; j++)
            reading += row[j] * u[j];
        for (int j = 0; j < 6; j++)
            reading += turned[j] * product[j];
        x[*i] = l->state[0][0] * was + l->state[0][1] * rate + l->input[0] * reading;
        x[SENSORS + *i] = l->state[1][0] * was + l->state[1][1] * rate + l->input[1] * reading;
        readings[*i] = s->gain[*i] * x[*i] + (errors[*i] + s->bias[*i]);
        met = met || fabs(readings[*i]) > s->range[*i];
    }
    data[s->saturated] = 0.0;
    if (met && data[s->met] == 0.0) {
        data[s->met] = 1.0;
        warn_of_range(s, core, readings);
    }
    return CALL_DONE;
}

enum { SEARCHING, ACQUIRING, LOCKED }; /* what `lock` is: where the target is not, where it has been for too short a time, or measured */

/* The next state of a tracker: Tracker.judge. */
INLINE int judge(const Tracker *t, int lock, const double *place, bool is_visible, double elapsed)
{
    double largest = 0.0;
    for (int k = 0; k < 4; k++)
        largest = fabs(place[k]) > largest ? fabs(place[k]) : largest;
    if (!is_visible || !(largest <= 1.0))
        return SEARCHING;
    if (lock == LOCKED)
        return LOCKED;
    if (largest > t->acquisition_share)
        return SEARCHING;
    return lock == ACQUIRING && elapsed >= t->acquisition_time ? LOCKED : ACQUIRING;
}

INLINE double find_norm(const double *quaternion)
{
    double sum = 0.0;
    for (int k = 0; k < 4; k++)
        sum += quaternion[k] * quaternion[k];
    return sqrt(sum);
}

/* An element: lock, and the measured error of a sample.  `data`: see the class LineOfSightSensor. */
INSTRUCTIONS static int64_t step_tracker(void *arguments, Core *core)
{
    Tracker *t = arguments;
    double *data = core->data, *error = data + t->error, *acquired = data + t->acquired, *lock = data + t->lock;
    const double *place = data + t->place, *sampled = data + t->sampled, h = core->step;
    const int was = *lock == LOCKED ? LOCKED : *lock == ACQUIRING ? ACQUIRING : SEARCHING;
    const int found = judge(t, was, place, data[t->visible] != 0.0, *acquired + 0.5 * h);
    if (found != was || found != ACQUIRING)
        *acquired = 0.0;
    *lock = found;
    if (found == ACQUIRING)
        *acquired += h;
    if (t->noisy) {
        const double number = (core->origin + (double)(core->count + 1) * h - data[t->start]) / t->sample_time;
        const int64_t sample = number >= 1.0 ? (int64_t)ceil(limit(number - 1e-6, 1e15)) - 1 : 0;
        if (sample != t->sample)
            find_tracker_noise(t->words, t->n_words, sample, t->noise);
        t->sample = sample;
    }
    for (int k = 0; k < 3; k++)
        error[k] = found == LOCKED && t->measured[k] ? sampled[k] + t->noise[k] * t->deviation[k] : 0.0;
    error[3] = found == LOCKED;
    if (fabs(place[3]) > 1.0 && !t->has_warned) {
        t->has_warned = 1;
        write_message(core, MESSAGE_WARNING, "payload_attitude and target_attitude have the norms %.6g and %.6g: expected "
                      "unit quaternions, scalar first; there is no lock as long as they are none",
                      find_norm(data + t->payload), find_norm(data + t->target));
    }
    return CALL_DONE;
}

/* What is wrong with steps of this size for contacts with the stops; each larger size is told of once. */
INLINE void warn_of_stops(Coils *c, Core *core)
{
    const double h = core->step, steps = c->contact_time / h;
    if (!(h > c->warned_step) || !(steps < c->fewest_steps || h > c->longest_step))
        return;
    c->warned_step = h;
    if (h > c->longest_step)
        write_message(core, MESSAGE_WARNING, "stop.stiffness, stop.damping: contacts with the stops are unstable at steps of "
                      "%g s and will be refused; expected steps of at most %.3g s", h, c->longest_step);
    else
        write_message(core, MESSAGE_WARNING, "stop.stiffness: a contact with a stop lasts %.1f steps of %g s; expected %g or "
                      "more. The leg needs a damping of %.3g N.s/m", steps, h, c->fewest_steps,
                      c->stiffness * c->stiffness * (h * h * h) / c->effective_mass);
}

/* Whether a contact is refused, since the step is too long for it. */
INLINE bool refuse_contact(const Coils *c, Core *core, const double *displacement)
{
    int leg = 0;
    for (int i = 1; i < 3; i++)
        leg = fabs(displacement[i]) > fabs(displacement[leg]) ? i : leg;
    if (!(core->step > c->longest_step && fabs(displacement[leg]) > c->distance))
        return false;
    write_message(core, MESSAGE_REFUSAL, "fine_displacement_%d = %.6g m is beyond the stop at %g m, and steps of %g s make "
                  "contacts unstable; expected steps of at most %.3g s, or a smaller stop.stiffness or stop.damping",
                  leg + 1, displacement[leg], c->distance, core->step, c->longest_step);
    return true;
}

/* Hold a value within +-most, if that is not 0; whether it had to be. */
INLINE double hold_within(double *value, double most)
{
    if (most == 0.0 || fabs(*value) <= most)
        return 0.0;
    *value = *value < 0.0 ? -most : most;
    return 1.0;
}

/* A step of the circuit: the coefficients of voice_coil.py. */
INLINE void discretise_coils(Coils *c, double h)
{
    const double less = -exponential_less_one(-c->resistance * h / c->inductance);
    c->step = h;
    c->decay = exponential(-c->resistance * h / c->inductance);
    c->response = less / c->resistance;
    c->gain = -exponential_less_one(-6.283185307179586 * c->bandwidth * h) / c->response;
    c->deviation = c->noise / sqrt(2.0 * h);
}

/* Forces of both stops on a leg, by the spring of each and by its damper (stops.py); whether the leg is at a stop. */
INLINE bool push_back(const Coils *c, double displacement, double velocity, double *forces)
{
    const double ahead = displacement + c->steps_ahead * c->step * velocity, damped = c->damping * velocity;
    const double above = ahead > c->distance ? ahead - c->distance : 0.0;
    const double below = ahead < -c->distance ? ahead + c->distance : 0.0;
    forces[0] = -c->stiffness * above;
    forces[1] = -c->stiffness * below;
    forces[2] = -c->stiffness * (above * (damped < -1.0 ? -1.0 : damped));
    forces[3] = -c->stiffness * (below * (-damped < -1.0 ? -1.0 : -damped));
    return fabs(ahead) > c->distance;
}

/* An element: the whole step of the voice coils.  `data`: see the class VoiceCoils. */
INSTRUCTIONS static int64_t step_coils(void *arguments, Core *core)
{
    enum { LEGS = 3, FORCE = 0, CURRENT = 3, VOLTAGE = 6, POWER = 9, STOP = 12, CONTACTS = 15, SATURATED, CONTACT };
    Coils *c = arguments;
    double *data = core->data, *y = data + c->outputs, *current = data + c->currents, *counted = data + c->counted;
    const double *command = data + c->inputs, *added = command + 3, *displacement = command + 6, *velocity = command + 9;
    const double h = core->step, ampere = 1.0 / c->force_constant;
    if (refuse_contact(c, core, displacement))
        return CALL_REFUSED;
    warn_of_stops(c, core);
    if (h != c->step)
        discretise_coils(c, h);
    static const double NO_NOISE[LEGS] = {0.0};
    const double *white = NO_NOISE;
    if (c->noise != 0.0) {
        const double before = (core->origin + h - data[c->start]) / h; /* steps that ended before those of this size */
        const int64_t sample = (fabs(before) < 1e15 ? (int64_t)round_to_whole(before) : 0) + core->count;
        white = find_white(&c->white, sample > 0 ? sample : 0);
    }
    y[SATURATED] = y[CONTACT] = y[CONTACTS] = 0.0;
    for (int i = 0; i < LEGS; i++) {
        const double d = displacement[i];
        double demand = ampere * command[i] + ampere * added[i], cosine, sine = 0.0, stop[4] = {0.0};
        if (c->resolution != 0.0 && fabs(demand / c->resolution) < 1e15)
            demand = round_to_whole(demand / c->resolution) * c->resolution;
        demand += c->deviation * white[i];
        y[SATURATED] += hold_within(&demand, c->current_limit);
        if (c->ripple != 0.0)
            turn_any((c->ripple_factor * d + c->ripple_phase) / 6.283185307179586, &cosine, &sine);
        const double constant = c->force_constant + c->stroke_factor * (d * d) + c->force_constant * c->ripple * sine;
        const double emf = constant * velocity[i];
        double voltage = (c->resistance - c->gain) * current[i] + c->gain * demand + c->compensation * emf;
        y[SATURATED] += hold_within(&voltage, c->supply_voltage);
        const double was = current[i], ohm = c->resistance;
        current[i] = c->decay * was + c->response * voltage + -c->response * emf;
        y[CURRENT + i] = current[i];
        y[VOLTAGE + i] = voltage;
        y[POWER + i] = (ohm * c->decay * was + ohm * c->response * voltage + ohm * -c->response * emf) * current[i];
        if (c->stiffness != 0.0 && push_back(c, d, velocity[i], stop))
            y[CONTACT] = 1.0;
        y[STOP + i] = stop[0] + stop[1] + stop[2] + stop[3];
        y[FORCE + i] = constant * current[i] + stop[0] + stop[1] + stop[2] + stop[3];
        const double pushed = y[STOP + i] != 0.0;
        counted[LEGS + i] += pushed > counted[i];
        counted[i] = pushed;
        y[CONTACTS] += counted[LEGS + i];
    }
    y[SATURATED] = y[SATURATED] > 0.0;
    return CALL_DONE;
}
