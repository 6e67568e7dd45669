/* Settings of the whole process, which no FMU may change (FMI 2.0.4, section 2.1). */
#ifndef PS_FMU_SETTINGS_H
#define PS_FMU_SETTINGS_H

/* Remember the settings. */
void settings_keep(void);

/* The first setting that has changed since; NULL if none has. */
const char *settings_changed(void);

#endif
