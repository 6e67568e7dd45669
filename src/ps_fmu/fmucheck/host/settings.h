/* What belongs to the whole process, and no FMU may change (FMI 2.0.4, section 2.1). */
#ifndef PS_FMU_SETTINGS_H
#define PS_FMU_SETTINGS_H

/* Remember how it is. */
void settings_keep(void);

/* What is not as it was; NULL if all is. */
const char *settings_changed(void);

#endif
