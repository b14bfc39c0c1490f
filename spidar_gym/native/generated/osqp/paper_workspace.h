/*
 * 
 * This file contains the prototype for the solver structure needed
 * by OSQP. The actual data is contained inside paper_workspace.c.
 */

#ifndef PAPER_WORKSPACE_H
#define PAPER_WORKSPACE_H

#include "osqp_api_types.h"

#ifdef __cplusplus
extern "C" {
#endif

  extern OSQPSolver paper_solver;

#ifdef __cplusplus
}
#endif

#endif /* ifndef PAPER_WORKSPACE_H */
