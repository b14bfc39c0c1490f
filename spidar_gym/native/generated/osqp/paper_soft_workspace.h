/* Generated: the workspace of OSQP for paper_soft. */
#ifndef PAPER_SOFT_WORKSPACE_H
#define PAPER_SOFT_WORKSPACE_H

#include <stddef.h>
#include <stdint.h>
#include "types.h"
#include "algebra_impl.h"
#include "qdldl_interface.h"

typedef struct {
    OSQPSettings settings;
    OSQPFloat sol_x[46];
    OSQPFloat sol_y[70];
    OSQPFloat sol_prim_inf_cert[70];
    OSQPFloat sol_dual_inf_cert[46];
    OSQPSolution sol;
    OSQPInfo info;
    OSQPInt data_P_csc_p[47];
    OSQPInt data_P_csc_i[106];
    OSQPFloat data_P_csc_x[106];
    OSQPCscMatrix data_P_csc;
    OSQPMatrix data_P;
    OSQPInt data_A_csc_p[47];
    OSQPInt data_A_csc_i[326];
    OSQPFloat data_A_csc_x[326];
    OSQPCscMatrix data_A_csc;
    OSQPMatrix data_A;
    OSQPFloat data_q_val[46];
    OSQPVectorf data_q;
    OSQPFloat data_l_val[70];
    OSQPVectorf data_l;
    OSQPFloat data_u_val[70];
    OSQPVectorf data_u;
    OSQPData data;
    OSQPInt linsys_L_p[117];
    OSQPInt linsys_L_i[402];
    OSQPFloat linsys_L_x[402];
    OSQPCscMatrix linsys_L;
    OSQPFloat linsys_Dinv[116];
    OSQPInt linsys_P[116];
    OSQPFloat linsys_bp[116];
    OSQPFloat linsys_sol[116];
    OSQPFloat linsys_rho_inv_vec[70];
    OSQPInt linsys_KKT_p[117];
    OSQPInt linsys_KKT_i[502];
    OSQPFloat linsys_KKT_x[502];
    OSQPCscMatrix linsys_KKT;
    OSQPInt linsys_PtoKKT[106];
    OSQPInt linsys_AtoKKT[326];
    OSQPInt linsys_rhotoKKT[70];
    OSQPFloat linsys_D[116];
    OSQPInt linsys_etree[116];
    OSQPInt linsys_Lnz[116];
    QDLDL_int linsys_iwork[348];
    QDLDL_bool linsys_bwork[116];
    QDLDL_float linsys_fwork[116];
    qdldl_solver linsys;
    OSQPFloat work_rho_vec_val[70];
    OSQPVectorf work_rho_vec;
    OSQPFloat work_rho_inv_vec_val[70];
    OSQPVectorf work_rho_inv_vec;
    OSQPInt work_constr_type_val[70];
    OSQPVectori work_constr_type;
    OSQPFloat work_x_val[46];
    OSQPVectorf work_x;
    OSQPFloat work_y_val[70];
    OSQPVectorf work_y;
    OSQPFloat work_z_val[70];
    OSQPVectorf work_z;
    OSQPFloat work_xz_tilde_val[116];
    OSQPVectorf work_xz_tilde;
    OSQPVectorf work_xtilde_view;
    OSQPVectorf work_ztilde_view;
    OSQPFloat work_x_prev_val[46];
    OSQPVectorf work_x_prev;
    OSQPFloat work_z_prev_val[70];
    OSQPVectorf work_z_prev;
    OSQPFloat work_Ax_val[70];
    OSQPVectorf work_Ax;
    OSQPFloat work_Px_val[46];
    OSQPVectorf work_Px;
    OSQPFloat work_Aty_val[46];
    OSQPVectorf work_Aty;
    OSQPFloat work_delta_y_val[70];
    OSQPVectorf work_delta_y;
    OSQPFloat work_Atdelta_y_val[46];
    OSQPVectorf work_Atdelta_y;
    OSQPFloat work_delta_x_val[46];
    OSQPVectorf work_delta_x;
    OSQPFloat work_Pdelta_x_val[46];
    OSQPVectorf work_Pdelta_x;
    OSQPFloat work_Adelta_x_val[70];
    OSQPVectorf work_Adelta_x;
    OSQPFloat work_D_temp_val[46];
    OSQPVectorf work_D_temp;
    OSQPFloat work_D_temp_A_val[46];
    OSQPVectorf work_D_temp_A;
    OSQPFloat work_E_temp_val[70];
    OSQPVectorf work_E_temp;
    OSQPWorkspace work;
    OSQPSolver solver;
} paper_soft_space;
extern const paper_soft_space paper_soft_SPACE;
static const uint32_t paper_soft_POINTERS[89] = {
    offsetof(paper_soft_space, sol) + offsetof(OSQPSolution, x), offsetof(paper_soft_space, sol) + offsetof(OSQPSolution, y), offsetof(paper_soft_space, sol) + offsetof(OSQPSolution, prim_inf_cert), offsetof(paper_soft_space, sol) + offsetof(OSQPSolution, dual_inf_cert),
    offsetof(paper_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, p), offsetof(paper_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, i), offsetof(paper_soft_space, data_P_csc) + offsetof(OSQPCscMatrix, x), offsetof(paper_soft_space, data_P) + offsetof(OSQPMatrix, csc),
    offsetof(paper_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, p), offsetof(paper_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, i), offsetof(paper_soft_space, data_A_csc) + offsetof(OSQPCscMatrix, x), offsetof(paper_soft_space, data_A) + offsetof(OSQPMatrix, csc),
    offsetof(paper_soft_space, data_q) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, data_l) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, data_u) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, data) + offsetof(OSQPData, P),
    offsetof(paper_soft_space, data) + offsetof(OSQPData, A), offsetof(paper_soft_space, data) + offsetof(OSQPData, q), offsetof(paper_soft_space, data) + offsetof(OSQPData, l), offsetof(paper_soft_space, data) + offsetof(OSQPData, u),
    offsetof(paper_soft_space, linsys_L) + offsetof(OSQPCscMatrix, p), offsetof(paper_soft_space, linsys_L) + offsetof(OSQPCscMatrix, i), offsetof(paper_soft_space, linsys_L) + offsetof(OSQPCscMatrix, x), offsetof(paper_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, p),
    offsetof(paper_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, i), offsetof(paper_soft_space, linsys_KKT) + offsetof(OSQPCscMatrix, x), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, L), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, Dinv),
    offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, P), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, bp), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, sol), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, rho_inv_vec),
    offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, KKT), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, PtoKKT), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, AtoKKT), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, rhotoKKT),
    offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, D), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, etree), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, Lnz), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, iwork),
    offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, bwork), offsetof(paper_soft_space, linsys) + offsetof(qdldl_solver, fwork), offsetof(paper_soft_space, work_rho_vec) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_rho_inv_vec) + offsetof(OSQPVectorf, values),
    offsetof(paper_soft_space, work_constr_type) + offsetof(OSQPVectori, values), offsetof(paper_soft_space, work_x) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_y) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_z) + offsetof(OSQPVectorf, values),
    offsetof(paper_soft_space, work_xz_tilde) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_xtilde_view) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_ztilde_view) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_x_prev) + offsetof(OSQPVectorf, values),
    offsetof(paper_soft_space, work_z_prev) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_Ax) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_Px) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_Aty) + offsetof(OSQPVectorf, values),
    offsetof(paper_soft_space, work_delta_y) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_Atdelta_y) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_delta_x) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_Pdelta_x) + offsetof(OSQPVectorf, values),
    offsetof(paper_soft_space, work_Adelta_x) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_D_temp) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_D_temp_A) + offsetof(OSQPVectorf, values), offsetof(paper_soft_space, work_E_temp) + offsetof(OSQPVectorf, values),
    offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, data), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, linsys_solver), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, rho_vec), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, rho_inv_vec),
    offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, constr_type), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, x), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, y), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, z),
    offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, xz_tilde), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, xtilde_view), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, ztilde_view), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, x_prev),
    offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, z_prev), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, Ax), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, Px), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, Aty),
    offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, delta_y), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, Atdelta_y), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, delta_x), offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, Pdelta_x),
    offsetof(paper_soft_space, work) + offsetof(OSQPWorkspace, Adelta_x), offsetof(paper_soft_space, solver) + offsetof(OSQPSolver, settings), offsetof(paper_soft_space, solver) + offsetof(OSQPSolver, solution), offsetof(paper_soft_space, solver) + offsetof(OSQPSolver, info),
    offsetof(paper_soft_space, solver) + offsetof(OSQPSolver, work),
};

#endif
